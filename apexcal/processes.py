"""Processes that do not outlive their starter, and sessions that end whole. The standard library alone.

Whoever starts a child gives it a session of its own (``start_new_session=True``): the session's id is the child's
process id, and one signal reaches all that the child has started.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable

_PR_SET_PDEATHSIG = 1
# Loaded here: between fork and exec nothing may be loaded.
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def die_with(parent: int) -> None:
    """Let this process be killed with its parent of that pid; end it at once if the parent is gone already.

    Linux sends the signal when the **thread** that started this process ends, so that thread must wait for it.
    Elsewhere a killed parent leaves its children to be found by hand.
    """
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def tied_to_this() -> Callable[[], None]:
    """Return the ``preexec_fn`` of a child that dies with this process."""
    parent = os.getpid()
    return lambda: die_with(parent)


def has_ended(pid: int) -> bool:
    """Whether a child has ended. It is not reaped: until then its pid, and so its session's, is nobody else's."""
    with contextlib.suppress(ChildProcessError):
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return True


def kill_session(pid: int) -> None:
    """Kill a child that leads its session, and all that it started, before the child is reaped."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)
