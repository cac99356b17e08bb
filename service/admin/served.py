"""Whether an `apexcal serve` holds a data folder, and where people find it.

The lock decides, because it ends with the process; the status file outlives a killed process.
"""

from __future__ import annotations

import fcntl
import json
from pathlib import Path
from typing import Any


def is_served(folder: Path) -> bool:
    """Whether an embedded service holds the folder now."""
    try:
        with (folder / "serve.lock").open() as lock:
            # A shared lock: processes that only look do not see each other as holders.
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def served_url(folder: Path) -> str | None:
    """The public address of the service that holds the folder; None where none does, or it has not said yet."""
    if not is_served(folder):
        return None
    try:
        status: Any = json.loads((folder / "supervisor.json").read_text(encoding="utf-8"))
        return str(status["public_url"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
