"""Limits that a process takes upon itself before it touches uploaded bytes."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
# An ingestion has its recording, one file for each sensor and a few of the libraries' open at once.
_OPEN_FILES: Final = 1024


def confine(*, parent: int | None, memory_bytes: int | None, cpu_s: int | None, file_bytes: int | None) -> None:
    """Die with the parent, and hold to limits of memory, CPU time and file size.

    The process limits itself, before it opens anything, instead of in a ``preexec_fn``: that would run Python
    between fork and exec of a parent with threads, where it may deadlock.

    Args:
        parent: pid of the starter; None: live on alone. Linux sends the signal when the **thread** that started this
            process ends, so that thread must wait for it.
        memory_bytes: address space (RLIMIT_AS); allocations beyond it fail with MemoryError.
        cpu_s: processor seconds (RLIMIT_CPU); beyond it SIGXCPU ends the process.
        file_bytes: size of any file that is written (RLIMIT_FSIZE); beyond it writes fail with EFBIG.
    """
    if parent is not None:
        if sys.platform == "linux":
            ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it died before the line above
            os._exit(1)
        open_files = min(_OPEN_FILES, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
        resource.setrlimit(resource.RLIMIT_NOFILE, (open_files, open_files))
    limits = ((resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_FSIZE, file_bytes))
    for kind, limit in limits:
        if limit is not None:
            resource.setrlimit(kind, (limit, limit))
    if cpu_s is not None:
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
