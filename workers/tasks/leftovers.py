"""Scratch folders of processes that died before they could remove them."""

from __future__ import annotations

import os
import shutil
import socket
from pathlib import Path


def scratch_prefix() -> str:
    """What the names of this host's scratch folders begin with: several hosts may share the data folder."""
    return f"{socket.gethostname()}-"


def remove_leftovers(scratch: Path) -> None:
    """Remove the folders of this host's dead processes; the maker's process id follows the host in the name."""
    if not scratch.is_dir():
        return
    for folder in scratch.glob(f"{scratch_prefix()}*"):
        pid = folder.name.removeprefix(scratch_prefix()).partition("-")[0]
        if pid.isdigit() and not _alive(int(pid)):
            shutil.rmtree(folder, ignore_errors=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
