"""Limits that a process takes upon itself before it touches uploaded bytes."""

from __future__ import annotations

import argparse
import json
import resource
from collections.abc import Mapping
from typing import Final

from apexcal.processes import die_with

# An ingestion has its recording, one file for each sensor and a few of the libraries' open at once.
_OPEN_FILES: Final = 1024


def add_child_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that a starter gives to every child."""
    parser.add_argument("--parent", type=int, help="pid of the starter; the child dies with it")
    parser.add_argument("--limits", type=json.loads, default={}, help="JSON: limits of memory, time and output")


def confine(parent: int | None, limits: Mapping[str, int]) -> None:
    """Die with the parent, and hold to limits of memory, CPU time and file size.

    The process limits itself, before it opens anything, instead of in a ``preexec_fn``: that would run Python
    between fork and exec of a parent with threads, where it may deadlock.

    Args:
        parent: pid of the starter; None: live on alone.
        limits: ``memory_bytes``: address space (RLIMIT_AS); allocations beyond it fail with MemoryError.
            ``cpu_s``: processor seconds (RLIMIT_CPU); beyond it SIGXCPU ends the process.
            ``file_bytes``: size of any file that is written (RLIMIT_FSIZE); beyond it writes fail with EFBIG.
    """
    if parent is not None:
        die_with(parent)
        open_files = min(_OPEN_FILES, resource.getrlimit(resource.RLIMIT_NOFILE)[1])
        resource.setrlimit(resource.RLIMIT_NOFILE, (open_files, open_files))
    # SIGXCPU comes at the first limit of time; SIGKILL would at the second.
    for kind, name, more in (
        (resource.RLIMIT_AS, "memory_bytes", 0),
        (resource.RLIMIT_FSIZE, "file_bytes", 0),
        (resource.RLIMIT_CPU, "cpu_s", 1),
    ):
        if name in limits:
            resource.setrlimit(kind, (limits[name], limits[name] + more))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
