"""One short simulation for all tests of this folder: 1 s, written once."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from apexcal.documents.simulation import SimulationOptions
from workers.simulation.rig import SimulatedRig
from workers.simulation.simulate import SimulationFiles, simulate


@dataclass(frozen=True)
class Short:
    files: SimulationFiles
    rig: SimulatedRig
    truth: dict[str, Any]
    progress: list[tuple[str, int, int]]


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory) -> Short:
    options = SimulationOptions(seconds=1.0, seed=3)
    out: Path = tmp_path_factory.mktemp("simulation")
    progress: list[tuple[str, int, int]] = []
    files = simulate(options, out, lambda stage, done, total: progress.append((stage, done, total)))
    return Short(files, SimulatedRig(options), json.loads(files.truth.read_text()), progress)
