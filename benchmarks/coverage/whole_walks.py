"""Whole walks: the product's simulator, detector and pairing; only the marks are drawn, by the law of each cell.

All errors that the service assumes by default (board, range, elevation, people) count.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from apexcal.documents.simulation import SimulationOptions
from apexcal.geometry.se3 import to_document
from benchmarks.coverage.draws import DrawScore, score
from benchmarks.coverage.marks import Errors
from benchmarks.coverage.walks import Paired, Walked
from benchmarks.judge.cases import drawn, random_lens
from workers.simulation.camera import FRONT, nominal_mount
from workers.simulation.rig import SimulatedRig
from workers.simulation.scene import WALKER_REGION
from workers.simulation.sensors import SENSORS
from workers.vertices.detectors import detect_range
from workers.vertices.pairing import pair_interpolated
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import Vertex

_SECONDS: Final = (60.0, 90.0)
_PAIRS: Final = 240
_MAX_GAP_NS: Final = 50_000_000
_PLANS: Final = ("rows", "field")
# What marks err by, and the deviation of the clocks' offset, ms.
WALK_CELLS: Final[dict[str, tuple[Errors, float]]] = {
    "walks, clean": (Errors(), 1.5),
    "walks, 15 % wrong": (Errors(blunders=0.15), 1.5),
    "walks, clock": (Errors(), 10.0),
    "walks, shutter": (Errors(line_time_us=26.0), 1.5),
}


def walk_scores(seed: int) -> list[DrawScore | None]:
    """Simulate the walk of a seed, find its vertices, and calibrate it once for each of `WALK_CELLS`."""
    random = np.random.default_rng([seed, 83])
    options = SimulationOptions(
        seconds=float(random.uniform(*_SECONDS)),
        seed=seed,
        sensor=sorted(SENSORS)[int(random.integers(len(SENSORS)))],
        walk=_PLANS[int(random.integers(len(_PLANS)))],
        pitch_down_deg=float(random.uniform(6.0, 16.0)),
        camera_model=random_lens(random),
    )
    rig = SimulatedRig(options)
    sweeps = list(rig.sweeps())
    width_m, height_m = options.board_m()
    size = {"board_width_m": width_m, "board_height_m": height_m}
    detections = detect_range(
        Listed(sweeps), Region.from_document(WALKER_REGION), "refined", size, indices=range(len(sweeps))
    )
    scores: list[DrawScore | None] = []
    for errors, clock_ms in WALK_CELLS.values():
        late_ms = float(random.normal(0.0, clock_ms))
        draw = drawn(_paired(rig, detections.vertices, late_ms), errors, random, common_errors={"clock_ms": clock_ms})
        scores.append(score(draw))
    return scores


def _paired(rig: SimulatedRig, vertices: list[Vertex], late_ms: float) -> Paired:
    """The vertices that the camera sees, at most `_PAIRS`, paired under an offset that is wrong by `late_ms`."""
    camera = rig.cameras[0]
    offset_ns = round(1e6 * late_ms)
    moved = pair_interpolated(vertices, camera.times_ns, offset_ns=-offset_ns, max_gap_ns=_MAX_GAP_NS)
    _, first = np.unique(moved.index, return_index=True)  # a frame belongs to one vertex
    rows = first[moved.index[first] >= 0]
    walked = Walked(rig)
    pixels = camera.camera.project(walked.poses(camera.times_ns[moved.index[rows]]).apex)
    seen = np.all([camera.camera.sees(pixels + margin) for margin in (-4.0, 0.0, 4.0)], axis=0)
    rows = rows[seen]
    rows = rows[np.unique(np.round(np.linspace(0, len(rows) - 1, min(_PAIRS, len(rows)))).astype(np.int64))]
    frames = moved.index[rows]
    taken = camera.times_ns[frames]
    return Paired(
        walked,
        camera.camera,
        to_document(nominal_mount(FRONT, 0.0, rig.options.pitch_down_deg)),
        moved.xyz[rows],
        np.sqrt(np.diagonal(moved.covariance[rows], axis1=1, axis2=2)),
        taken,
        taken + offset_ns,
        np.array([vertices[row].sweep_index for row in rows], np.int64),
        frames,
        np.zeros(len(rows), np.int64),
        np.arange(len(rows)),
    )
