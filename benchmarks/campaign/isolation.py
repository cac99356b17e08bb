"""Surroundings that can fail without harm to anything else: a small file system, and processes that obey modes."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

_CLONE_NEWNS = 0x00020000
_CLONE_NEWUSER = 0x10000000
_MS_PRIVATE_RECURSIVE = (1 << 18) | (1 << 14)
_PR_CAPBSET_DROP = 24
_DAC_CAPABILITIES = (1, 2)
_libc = ctypes.CDLL(None, use_errno=True)


def small_file_system(folder: Path, size_bytes: int) -> bool:
    """Mount one in memory that only this process and its children see, and that goes with them; False: not allowed.

    Call it while the process has one thread.
    """
    uid, gid = os.getuid(), os.getgid()
    if _libc.unshare(_CLONE_NEWNS if uid == 0 else _CLONE_NEWNS | _CLONE_NEWUSER) != 0:
        return False
    if uid != 0:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{uid} {uid} 1")
        Path("/proc/self/gid_map").write_text(f"{gid} {gid} 1")
    private = _libc.mount(b"none", b"/", None, _MS_PRIVATE_RECURSIVE, None) == 0
    options = f"size={size_bytes},mode=700".encode()
    return private and _libc.mount(b"tmpfs", os.fsencode(folder), b"tmpfs", 0, options) == 0


def let_modes_bind_children() -> None:
    """Processes started from now on may not pass by a folder's mode, though root starts them."""
    for capability in _DAC_CAPABILITIES:
        _libc.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
