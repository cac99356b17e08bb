"""Simulated walks that tests share, made once for a state of the simulator: `python -m tests.support.walks`.

They lie in the environment, in folders that nobody writes into.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path

from apexcal.documents.simulation import SimulationOptions
from tests.support.places import ROOT
from workers.simulation.simulate import simulate

_FOLDER = Path(sys.prefix) / "walks"
_SOURCES = ("workers/simulation", "workers/geometry", "apexcal/geometry", "apexcal/documents/simulation.py")

WALKS = {
    "moment": SimulationOptions(seconds=1),
    # Whoever has it searched for boards pays for each second.
    "short": SimulationOptions(seconds=6),
    # As the simulator writes one; long enough that work on it can be interrupted.
    "plain": SimulationOptions(seconds=12),
    # That of somebody who practises with the pages of the documentation.
    "practice": SimulationOptions(seconds=14, seed=3),
    # With CameraInfo, a tree of frames and a URDF.
    "with-tree": SimulationOptions(seconds=12, camera_hz=5, camera_info="raw"),
    # The same, long enough to be calibrated without a warning.
    "long": SimulationOptions(seconds=40, camera_hz=3, camera_info="raw"),
}


def walk(name: str) -> Path:
    """The folder of a walk: its recording, rig.json, region.json and truth.json; vehicle.urdf beside a tree."""
    folder = _FOLDER / _state() / name
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=folder.parent))
        simulate(WALKS[name], scratch / name)
        try:
            (scratch / name).rename(folder)
        except OSError:  # another process has made it meanwhile
            assert folder.exists()
        shutil.rmtree(scratch)
    return folder


@cache
def _state() -> str:
    """What the simulator's sources are, and what it is asked for."""
    digest = hashlib.sha256(repr(WALKS).encode())
    for source in _SOURCES:
        files = sorted((ROOT / source).rglob("*.py")) if (ROOT / source).is_dir() else [ROOT / source]
        for file in files:
            digest.update(os.fsencode(file.relative_to(ROOT)) + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    for other in _FOLDER.glob("*"):
        if other.name != _state():
            shutil.rmtree(other)
    for name in WALKS:
        walk(name)
