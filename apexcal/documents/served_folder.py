"""The data folder of an `apexcal serve`: whether a service holds it now, and what its supervisor wrote there.

The lock decides, because it ends with the process; the status file outlives a killed process.
"""

from __future__ import annotations

import fcntl
import json
from pathlib import Path
from typing import Any


def read_status(root: Path) -> dict[str, Any]:
    """Return the document that the supervisor of ``root`` wrote last; empty without one."""
    try:
        status = json.loads((root / "supervisor.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return status if isinstance(status, dict) else {}


def is_served(root: Path) -> bool:
    """Whether an embedded service holds ``root`` now."""
    try:
        with (root / "serve.lock").open() as lock:
            # A shared lock: processes that only look do not see each other as holders.
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
