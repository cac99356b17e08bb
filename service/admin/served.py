"""Whether an `apexcal serve` holds a data folder, and where people find it.

Its lock tells, for that ends with the process; its status file outlives a process that was killed.
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
            # Shared: who looks is no holder to others who look.
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
