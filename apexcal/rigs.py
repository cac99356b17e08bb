"""Rig descriptions as people keep them in files: the body of ``POST /v1/vehicles/{id}/rigs``."""

from __future__ import annotations

from pathlib import Path

from apexcal.errors import InputError
from apexcal.json_files import read_document
from apexcal.transport import Document


def read_rig(path: Path, name: str = "") -> Document:
    """A rig's description from a JSON file, the simulator's ``rig.json`` among them, or what ``inspect --json`` says.

    ``name`` stands above the file's own; where there is neither, the folder's is taken. What the description says is
    checked by the service. Raises :class:`InputError` where the file holds none.
    """
    document = read_document(path)
    if isinstance(document, dict) and isinstance(document.get("proposal"), dict):
        document = document["proposal"].get("rig")
    if not isinstance(document, dict) or not {"lidar", "cameras"} <= set(document):
        raise InputError(f"{path} describes no rig", "It needs `lidar` and `cameras`; docs/rigs.md shows one.")
    return {**document, "name": name or document.get("name") or path.resolve().parent.name}
