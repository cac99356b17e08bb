"""One draw: a fit of the training pairs, and its errors there, on held-out pairs and all over the field."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import apexcal
from apexcal.documents.fit_requests import fit_request
from apexcal.documents.pairs import SIGMAS
from apexcal.geometry.se3 import to_document
from benchmarks.judge.judging import projected
from benchmarks.paper.pairs import make_pairs
from benchmarks.paper.recordings import Walked, field_points
from workers.simulation.camera import IMAGE_SIZE, make_camera, nominal_mount
from workers.solver.clock_offset import estimate_offset
from workers.vertices.tracks import Track

# The true lens, the paper's loss over all pairs, and a few slots: more iterations end in the same optimum.
_MODEL: Final = "brown_conrady"
_REQUEST: Final[dict[str, Any]] = {
    "loss": "mean",
    "outliers": "keep",
    "mark_sigma_px": 1.0,
    "schedule": {"slots": 3, "max_iterations": 2},
}
DETECTORS: Final = ("strict", "refined")


class Score(NamedTuple):
    """Mean errors in px of one detector's pairs and draw, and the clocks' offset as estimated (ms)."""

    detector: str
    train_px: float
    heldout_px: float
    truth_px: float
    offset_ms: float


def score(train: Walked, test: Walked, detector: str, repeat: int) -> Score:
    """Fit the training pairs, of `refined` vertices at the clocks' estimated offset, and look at tests and truth.

    The camera is 15 degrees down, off its nominal mount by a degree and centimetres. Its lens is the simulator's,
    about 100 degrees wide; the paper does not state its own.
    """
    camera, nominal = make_camera(_MODEL, train.wanted.seed), nominal_mount()
    offset_ns: int | None = None
    if detector == "refined":
        marked = make_pairs(train, camera, detector, None, repeat)
        asked = fit_request(_MODEL, IMAGE_SIZE, to_document(nominal), **_REQUEST)
        track = Track.of(train.vertices[detector])
        offset_ns = estimate_offset(track, marked.stamps_ns, marked.marks, asked).offset_ns
    pairs, heldout = (make_pairs(walked, camera, detector, offset_ns, repeat) for walked in (train, test))
    stated: dict[str, Any] = {} if offset_ns is None else dict(zip(SIGMAS, pairs.sigmas.T.tolist(), strict=True))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = nominal.R, nominal.t
    request = _REQUEST | {"weights": "covariances" if stated else "equal", "seed": repeat}
    result = apexcal.fit(pairs.points, pairs.marks, IMAGE_SIZE, _MODEL, T_camera_lidar=T, columns=stated, **request)
    field = field_points(train.rig.scene.ground_z)
    field = field[camera.sees(camera.project(field))]

    def error_px(points: NDArray[np.float64], pixels: NDArray[np.float64]) -> float:
        return float(np.mean(np.hypot(*(projected(result, points) - pixels).T)))

    errors = (error_px(pairs.points, pairs.marks), error_px(heldout.points, heldout.marks))
    return Score(detector, *errors, error_px(field, camera.project(field)), (offset_ns or 0) * 1e-6)
