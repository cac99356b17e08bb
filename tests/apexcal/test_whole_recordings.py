"""Whole recordings with faults, from the bag to a calibration that publishes itself: none that is wrong does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple
from uuid import UUID

import numpy as np
import pytest
from scipy import stats

from apexcal.client import Client
from apexcal.documents.camera_models import DEFAULT_MODELS as MODELS
from apexcal.documents.simulation import SimulationOptions
from apexcal.geometry.se3 import to_document
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.walks import Paired, Walked
from benchmarks.judge.cases import NOISE_PX, Draw
from tests.apexcal.published import published
from workers.simulation.camera import FRONT
from workers.simulation.rig import SimulatedRig

# RECORDINGS=1 is a short run of each case.
RECORDINGS: Final = int(os.environ.get("RECORDINGS", "10"))
SECONDS: Final = 120
MARKS: Final = 240
"""Frames that a person marks of a walk."""
_ELSEWHERE_M: Final = 0.35
# Measured by whoever carries it, metres.
_BOARD: Final = {"board_width_m": 0.6096, "board_height_m": 0.9144}
# Of sound recordings at least this share publish themselves, but for one test in a thousand.
_SOUND: Final = 0.9
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

Random = np.random.Generator


class Fault(NamedTuple):
    """The camera's possible lenses, the model that is asked for (None: the lens's own), and errors of the marks."""

    lenses: tuple[str, ...] = MODELS
    model: str | None = None
    errors: Callable[[Random], Errors] = lambda random: Errors()


def _turned(random: Random) -> Errors:
    return Errors(second_half_deg=float(np.exp(random.uniform(np.log(0.15), np.log(1.5)))))


FAULTS: Final = {
    "people, none wrong": Fault(),
    "15 % on the hand": Fault(errors=lambda random: Errors(on_hand=0.15)),
    "wrong model": Fault(lenses=MODELS[1:], model="pinhole"),
    "turned halfway": Fault(errors=_turned),
}


@pytest.mark.parametrize("name", FAULTS)
def test_of_whole_recordings_no_wrong_calibration_publishes_itself(owner: Client, tmp_path: Path, name: str) -> None:
    fleet = owner.fleets.create(f"{name} {tmp_path}")
    seed = int(np.random.default_rng().integers(10**6))
    draws: dict[UUID, Draw] = {}
    for number in range(RECORDINGS):
        random = np.random.default_rng([seed + number, 71])
        folder = _simulated(tmp_path / str(number), seed + number, FAULTS[name], random)
        draw, marks = _drawn(folder, FAULTS[name], random)
        vehicle = owner.vehicles.create(fleet.id, f"{name} {seed + number}").id
        _calibrate(owner, vehicle, folder, draw, marks)
        draws[vehicle] = draw
        (folder / "recording.bag").unlink()
    of_all, wrong = published(owner, draws)
    print(f"{name}, seed {seed}: {len(of_all)} of {RECORDINGS} published, {len(wrong)} of them wrong")
    assert wrong == []
    if name == "people, none wrong":
        assert len(of_all) >= stats.binom.ppf(1e-3, RECORDINGS, _SOUND)


def _simulated(folder: Path, seed: int, fault: Fault, random: Random) -> Path:
    """Write a walk, seen through one of the fault's lenses."""
    command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seed", str(seed)]
    command += ["--seconds", str(SECONDS), "--camera-hz", "5", "--camera-model", str(random.choice(fault.lenses))]
    command += ["--pitch-down-deg", f"{random.uniform(6.0, 16.0):.2f}"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def _drawn(folder: Path, fault: Fault, random: Random) -> tuple[Draw, dict[int, list[float]]]:
    """Return what error_of() needs of the recording, and by each frame's stamp where its tip is marked, px."""
    rig = SimulatedRig(SimulationOptions(**json.loads((folder / "truth.json").read_text())["settings"]))
    mounted, errors = rig.cameras[0], fault.errors(random)
    walked = Walked(rig)
    tips = walked.poses(mounted.times_ns).apex
    frames = np.flatnonzero(mounted.camera.sees(mounted.camera.project(tips)))
    count, taken = len(frames), mounted.times_ns[frames]
    paired = Paired(
        walked,
        mounted.camera,
        to_document(mounted.nominal),
        tips[frames],
        np.zeros((count, 3)),
        taken,
        taken,
        frames,
        frames,
        np.zeros(count, np.int64),
        np.arange(count),
    )
    noises_px = tuple(random.uniform(*NOISE_PX, size=2).tolist())
    known = columns(paired, replace(errors, noises_px=noises_px), random)
    last = np.array(mounted.camera.image_size) - 1.0
    marks = np.clip(np.column_stack([known["u"], known["v"]]), 0.0, last).tolist()
    request: dict[str, Any] = {"models": [fault.model or mounted.camera.model]}
    stamps = mounted.stamps_ns[frames].tolist()
    return Draw(paired, known, request, errors.second_half_deg), dict(zip(stamps, marks, strict=True))


def _calibrate(owner: Client, vehicle: UUID, folder: Path, draw: Draw, marks: dict[int, list[float]]) -> None:
    """Upload the recording, detect and mark its vertices, and ask for a calibration that publishes itself."""
    rig = owner.vehicles.create_rig(vehicle, json.loads((folder / "rig.json").read_text()))
    recording = owner.wait(owner.recordings.upload(folder / "recording.bag", vehicle, rig.id), timeout_s=900)
    region = json.loads((folder / "region.json").read_text())
    asked = owner.detections.create(recording.id, region, detector="refined", options=_BOARD, mode="interpolate")
    detection = owner.wait(asked, timeout_s=1800)
    tips = dict(zip(marks, draw.paired.xyz, strict=True))
    confirmed = 0
    while confirmed < MARKS and (task := owner.marking.next_task(detection.id, FRONT)):
        vertex, stamp = task.vertex, task.frame.stamp_ns
        if stamp not in marks or np.linalg.norm([vertex.x, vertex.y, vertex.z] - tips[stamp]) > _ELSEWHERE_M:
            owner.marking.answer(task.task_id, "rejected")
            continue
        u, v = marks[stamp]
        owner.marking.answer(task.task_id, "confirmed", u=u, v=v)
        confirmed += 1
    pairs = owner.correspondence_sets.build(detection.id, FRONT)
    request = draw.request | {"publish": "recommended"}
    calibration = owner.wait(owner.calibrations.create(vehicle, [pairs.id], **request), timeout_s=900)
    print(
        [
            f"{check.name}: {check.sentence}"
            for check in calibration.summary.cameras[FRONT].checks
            if check.verdict != "pass"
        ]
    )
