"""What errors do where a result is used: to points at 5, 20 and 50 m over the field that marks cover."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.checks import USE_LIMIT_M, USE_LIMIT_PX, USE_LIMIT_RAD
from workers.solver.estimate import Estimate
from workers.solver.prediction import DISTANCES_M, covariances_along
from workers.solver.residuals import predict, transform_of

Floats = NDArray[np.float64]
# Marks that stand for the field, and the share of them that has to be good enough: their middle 95 %.
_MARKS: Final = 60
MIDDLE: Final = 0.95


def marked_rays(estimate: Estimate) -> Floats:
    """(R, 3) unit vectors, camera frame, towards vertices that stand for the field that marks cover."""
    problem, p = estimate.holding, estimate.held_at
    used = np.flatnonzero((problem.weights > 0.0) & (predict(problem, p)[1] == 0.0))
    rays = transform_of(problem, p).apply(problem.points[used[:: -(-len(used) // _MARKS)]])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def over_limit(px: Floats, mm: Floats) -> float:
    """Errors (distances, R) of points at `DISTANCES_M`, px and mm across the ray, over what use allows."""
    angle = 1e-3 * mm / np.array(DISTANCES_M)[:, None]
    limit_rad = np.maximum(USE_LIMIT_RAD, USE_LIMIT_M / np.array(DISTANCES_M))[:, None]
    return float(np.max(np.quantile(np.minimum(px / USE_LIMIT_PX, angle / limit_rad), MIDDLE, axis=1)))


def worst_axis(estimate: Estimate, covariance: Floats | None = None) -> tuple[Floats, Floats]:
    """(distances, R) deviations of those points in the direction in which each is known worst, px and mm.

    covariance (F, F): of the parameters; the estimate's own if it is left out.
    """
    px, mm = covariances_along(estimate, marked_rays(estimate), covariance)
    return np.sqrt(np.linalg.eigvalsh(px)[..., -1]), np.sqrt(np.linalg.eigvalsh(mm)[..., -1])


def moved_over_limit(estimate: Estimate, step: Floats) -> float:
    """How far a step (F,) of the parameters, rad, m and px, moves those points, over what use allows."""
    return over_limit(*worst_axis(estimate, np.outer(step, step)))
