"""Facts about pairs beside their fit: what explains their residuals, marks outside, times between the two."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.precision import FitPrecision
from apexcal.documents.results import Intrinsics
from workers.solver.problem import FitProblem

# Largest noise of a plane on real recordings, ring bias included (OS1-64). It holds for vertices that state nothing.
_VERTEX_M: Final = 0.016
_STILL_NS: Final = 1_000_000


def explained_px(problem: FitProblem, lens: Intrinsics, precision: FitPrecision) -> float:
    """Noise per coordinate that marks and vertices explain in a typical pair, px.

    It combines marks of `mark_sigma_px` and vertices known to 16 mm across their ray; or it is what pairs state, if
    that is more.
    """
    used = problem.weights > 0.0
    focal = 0.5 * (lens.f_x + lens.f_y)
    distance = np.maximum(np.linalg.norm(problem.points[used], axis=1), 1e-3)
    typical = float(np.sqrt(problem.mark_sigma_px**2 + np.median((focal * _VERTEX_M / distance) ** 2)))
    return max(typical, precision.sigma_px / precision.noise_scale) if precision.noise_scale else typical


def marks_outside(problem: FitProblem, chosen: NDArray[np.bool_] | None = None) -> int:
    """Return how many of the used marks, of the chosen (N,) or of all, lie more than a pixel outside of the image."""
    marks = problem.pixels[(problem.weights > 0.0) & (True if chosen is None else chosen)]
    return int(np.count_nonzero(np.any((marks < -1.5) | (marks > np.array(problem.image_size) + 0.5), axis=1)))


def paired_apart_ms(pairs: Mapping[str, Any]) -> float | None:
    """Return the median time, ms, between vertices and the frames that they were paired with and not moved to.

    None if they were moved, or the columns do not say.
    """
    gaps = np.abs(np.array(pairs.get("gap_ns") or [0], np.float64))
    return float(np.median(gaps)) / 1e6 if np.max(gaps) >= _STILL_NS else None
