"""Where people find the service that holds a data folder."""

from __future__ import annotations

from pathlib import Path

from apexcal.documents.served_folder import is_served, read_status


def served_url(folder: Path) -> str | None:
    """The public address of the service that holds the folder; None where none does, or it has not said yet."""
    url = read_status(folder).get("public_url") if is_served(folder) else None
    return None if url is None else str(url)
