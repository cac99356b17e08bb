"""One draw: a fit of the training pairs, and its errors there, on held-out pairs and all over the field."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from apexcal.documents.fit_requests import fit_request
from benchmarks.paper.fits import errors_of_truth, errors_on, fit
from benchmarks.paper.pairs import CLICK_PX, make_pairs
from benchmarks.paper.recordings import Walked, camera_of, field_points, request_of
from workers.geometry.models import ModelName
from workers.solver.clock_offset import estimate_offset

MODELS: Final[tuple[ModelName, ...]] = ("pinhole", "brown_conrady")
WAYS: Final = ("strict", "tolerant", "refined", "refined+clock")


class Score(NamedTuple):
    """Mean errors in px of one way, model and draw, and the clocks' offset as estimated (ms; 0 where it is not)."""

    way: str
    model: ModelName
    train_px: float
    heldout_px: float
    truth_px: float
    offset_ms: float


def score(train: Walked, test: Walked, way: str, model: ModelName, repeat: int) -> Score:
    """Fit the training pairs and look at the test pairs and at the truth."""
    camera = camera_of("brown_conrady", train.wanted.seed)
    detector, _, clock = way.partition("+")
    offset_ns: int | None = None
    if clock:
        marked = make_pairs(train, camera, detector, None, repeat)
        request = fit_request(**request_of("brown_conrady"), mark_sigma_px=CLICK_PX)
        offset_ns = estimate_offset(train.tracks[detector], marked.stamps_ns, marked.marks, request).offset_ns
    pairs, heldout = (make_pairs(walked, camera, detector, offset_ns, repeat) for walked in (train, test))
    fitted = fit(pairs, model, repeat)
    truth = errors_of_truth(fitted, camera, field_points(train.rig.scene.ground_z))
    errors = (float(np.mean(one)) for one in (errors_on(fitted, pairs), errors_on(fitted, heldout), truth))
    return Score(way, model, *errors, (offset_ns or 0) * 1e-6)
