"""One draw of the experiment: fits with every source of error, and with each of them switched off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from apexcal.documents.fit_requests import fit_request
from benchmarks.paper.fits import errors_of_truth, errors_on, fit, rms
from benchmarks.paper.pairs import CLICK_PX, Pairs, Switches, Way, make_pairs, without
from benchmarks.paper.recordings import Walked, camera_of, field_points, request_of
from workers.geometry.models import ModelName
from workers.solver.clock_offset import estimate_offset

MODELS: Final[tuple[ModelName, ...]] = ("pinhole", "brown_conrady")
WAYS: Final = ("strict", "tolerant", "refined", "refined+clock")
SOURCES: Final = ("vertices", "clocks", "clicks", "model")


@dataclass(frozen=True)
class Score:
    """One way, model and draw.

    Attributes:
        figures: for ``all`` and for each source that was switched off: mean and RMS px on training pairs, on held-out
            pairs, and against the truth over the field.
        offset_ms: of the clocks, as it was estimated; 0 where nobody asked.
        pairs: how many were fitted and how many were held out.
    """

    way: str
    model: ModelName
    figures: dict[str, dict[str, float]]
    offset_ms: float
    pairs: tuple[int, int]


def score(
    train: Walked, test: Walked, way: str, model: ModelName, repeat: int, sources: Sequence[str] = SOURCES
) -> Score:
    """Fit the training pairs and look at the test pairs, with every error and without each of the sources."""
    seed = train.wanted.seed
    detector, _, clock = way.partition("+")
    plain = Way(detector)
    offset_ns = 0
    if clock:
        marked = make_pairs(train, camera_of("brown_conrady", seed), plain, Switches(), repeat)
        offset_ns = _offset(train, detector, marked)
        plain = Way(detector, "interpolate", offset_ns)
    figures: dict[str, dict[str, float]] = {}
    pairs = (0, 0)
    for off in ("all", *sources):
        # Without an error of the model the lens is one that the model can be.
        camera = camera_of(model if off == "model" else "brown_conrady", seed)
        if off == "model" and model == "brown_conrady":
            continue
        switches = without(Switches(), off)
        fitted_to, heldout = (make_pairs(walked, camera, plain, switches, repeat) for walked in (train, test))
        fitted = fit(fitted_to, model, repeat)
        truth = errors_of_truth(fitted, camera, field_points(train.rig.scene.ground_z))
        errors = {"train": errors_on(fitted, fitted_to), "heldout": errors_on(fitted, heldout), "truth": truth}
        figures[off] = {f"{name}_px": float(np.mean(values)) for name, values in errors.items()}
        figures[off] |= {f"{name}_rms_px": rms(values) for name, values in errors.items()}
        if off == "all":
            pairs = (len(fitted_to.points), len(heldout.points))
    return Score(way, model, figures, offset_ns * 1e-6, pairs)


def _offset(train: Walked, detector: str, marked: Pairs) -> int:
    """The clocks' offset as it is estimated from the training marks alone, nanoseconds."""
    request = fit_request(**request_of("brown_conrady"), mark_sigma_px=CLICK_PX)
    return estimate_offset(train.tracks[detector], marked.stamps_ns, marked.marks, request).offset_ns
