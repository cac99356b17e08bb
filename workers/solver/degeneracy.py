"""Degeneracies of the pairs: parameters that stay open, and points without extent."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.polish import distances
from workers.solver.problem import FitProblem
from workers.solver.uncertainty import Uncertainty

Floats = NDArray[np.float64]
# Extent of the points across a line or plane, relative to along it, below which they count as lying in it: as flat
# as marks of a pixel and ranges of a centimetre can tell at the distances people walk.
_FLAT: Final = 1e-3
_COINCIDENT_M: Final = 1e-3
_PLANE: Final = "all lie in one plane"
_EXTRINSICS: Final = 6
# Standard deviations above which a value is arbitrary, unless the bounds alone say more. Those of f and c count in
# image widths.
_ARBITRARY: Final = {"deg": 10.0, "m": 1.0, "px": 0.2}


def is_determined(problem: FitProblem, p: Floats, spread: Uncertainty) -> bool:
    """Whether the pairs determine every free parameter, with at least one pair that the camera can see."""
    return not arbitrary(problem, spread) and bool(np.any(_seen(problem, p)))


def arbitrary(problem: FitProblem, spread: Uncertainty) -> dict[str, float]:
    """The free parameters that the pairs leave open, with their deviations in people's units (or infinite)."""
    width = (problem.upper - problem.lower)[problem.free]
    deviations: dict[str, float] = {}
    for name, unit, std, room in zip(spread.names, spread.units, spread.std.tolist(), width.tolist(), strict=True):
        limit = _ARBITRARY.get(unit, np.inf) * (problem.image_size[0] if unit == "px" else 1.0)
        if not np.isfinite(std) or min(std, np.degrees(room) if unit == "deg" else room) > limit:
            deviations[name] = std
    return deviations


def point_problem(problem: FitProblem, p: Floats) -> str | None:
    """A sentence on the points' extent, or on points that no camera at p (D,) could see; None if nothing is wrong."""
    used = problem.weights > 0.0
    unseen = int(np.count_nonzero(used & ~_seen(problem, p)))
    if unseen == np.count_nonzero(used):
        return "All points lie behind the camera or past the lens model's range, wherever the search looked."
    if unseen:
        return f"{unseen} pairs lie behind the camera or past the lens model's range, or an image away."
    different = len(np.unique(problem.points[used], axis=0))
    if 1 < different < 0.5 * len(problem.free):
        return f"The pairs show {different} different corners only, for {len(problem.free)} free parameters."
    shape = _shape(problem.points[used])
    # A plane holds a camera whose lens is known.
    if shape and not (shape == _PLANE and problem.free.max(initial=0) < _EXTRINSICS):
        return f"The corners {shape}, which does not determine position and lens together."
    return None


def _seen(problem: FitProblem, p: Floats) -> NDArray[np.bool_]:
    return distances(problem, p) < problem.diagonal_px


def _shape(points: Floats) -> str:
    centred = points - points.mean(axis=0)
    extent = np.linalg.svd(centred, compute_uv=False) / np.sqrt(len(points))
    if extent[0] < _COINCIDENT_M:
        return "all lie in one place"
    if extent[1] < _FLAT * extent[0]:
        return "all lie on one line"
    return _PLANE if extent[2] < _FLAT * extent[0] else ""
