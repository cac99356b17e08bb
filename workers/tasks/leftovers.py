"""Scratch folders of processes that died before they could remove them."""

from __future__ import annotations

import os
import re
import shutil
import socket
from pathlib import Path
from urllib.parse import quote

# It separates host and process. No quoted host name holds it: hosts may be called `gpu` and `gpu-7`.
_SEPARATOR = "+"


def scratch_prefix() -> str:
    """What the names of this process's scratch folders begin with: several hosts may share the data folder."""
    return _SEPARATOR.join((_host(), str(os.getpid()), ""))


def remove_leftovers(scratch: Path) -> None:
    """Remove the folders of this host's dead processes."""
    if not scratch.is_dir():
        return
    mine = re.compile(rf"{re.escape(_host() + _SEPARATOR)}(\d+){re.escape(_SEPARATOR)}.*")
    for folder in scratch.iterdir():
        found = mine.fullmatch(folder.name)
        if found and not _alive(int(found[1])):
            shutil.rmtree(folder, ignore_errors=True)


def _host() -> str:
    return quote(socket.gethostname(), safe="")


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
