"""One short simulation for all tests of this folder: 5 s, written once."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from workers.simulation.simulate import Rig, Settings, Simulated, simulate


@dataclass(frozen=True)
class Short:
    settings: Settings
    written: Simulated
    rig: Rig
    truth: dict[str, Any]
    description: dict[str, Any]
    progress: list[tuple[str, int, int]]


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory) -> Short:
    settings = Settings(seconds=5.0, seed=3)
    out: Path = tmp_path_factory.mktemp("simulation")
    progress: list[tuple[str, int, int]] = []
    written = simulate(settings, out, lambda stage, done, total: progress.append((stage, done, total)))
    truth = json.loads(written.truth.read_text())
    description = json.loads(written.rig.read_text())
    return Short(settings, written, Rig(settings), truth, description, progress)
