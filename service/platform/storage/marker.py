"""The file that tells a store's folder from an empty one.

A disk that is unmounted under a running service leaves an empty folder in its place: everything would seem to be
missing, and what is written would lie where nobody looks once the disk is back. So without the marker the store is
away.
"""

from __future__ import annotations

from pathlib import Path

MARKER = ".apexcal-store"
_SAYS = "Blobs of apexcal. Without this file the service takes the folder for one whose disk is not mounted.\n"


def is_marked(folder: Path) -> bool:
    """Whether the folder can be looked into and has its marker."""
    try:
        (folder / MARKER).stat()
    except OSError:
        return False
    return True


def mark(folder: Path) -> None:
    """Write the marker, unless it is there. It is durable when the folder's first object is."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARKER).write_text(_SAYS)
