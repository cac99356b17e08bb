"""The effect of errors where a result is used: to points at 5, 20 and 50 m over the field that marks cover."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.checks import USE_LIMIT_M, USE_LIMIT_PX, USE_LIMIT_RAD
from workers.solver.estimate import Estimate
from workers.solver.prediction import DISTANCES_M, derivatives_along, point_covariances
from workers.solver.residuals import predict, transform_of

Floats = NDArray[np.float64]
# Marks that stand for the field, and the share of them that has to be good enough: their middle 95 %.
_MARKS: Final = 60
MIDDLE: Final = 0.95
# Standard deviations of an effect that count against it before it is sure (95 %).
_SURE: Final = 2.0


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


class WorstAxis(NamedTuple):
    """Of the points of use, in the direction in which each is known worst, (distances, R) each.

    Attributes:
        px, mm: standard deviations.
        freedoms: degrees of freedom of the variance.
    """

    px: Floats
    mm: Floats
    freedoms: Floats


def worst_axis(estimate: Estimate) -> WorstAxis:
    """Return how well the points of use are known where they are known worst. The estimate states errors."""
    assert estimate.errors is not None
    _, blocks, back = derivatives_along(estimate, marked_rays(estimate))
    px, mm = point_covariances(estimate, blocks, back)
    variances, axes = np.linalg.eigh(px)
    along = np.einsum("nc,ncf->nf", axes[..., -1].reshape(-1, 2), blocks)
    freedoms = estimate.errors.freedoms(along).reshape(len(DISTANCES_M), -1)
    return WorstAxis(np.sqrt(variances[..., -1]), np.sqrt(np.linalg.eigvalsh(mm)[..., -1]), freedoms)


class Effect(NamedTuple):
    """The effect of a cause on those points, over the limit of use: its estimate, and the least that is sure.

    ``per_deviation``: what one standard deviation of the cause may do.
    """

    estimate: float
    at_least: float
    per_deviation: float


class PointsOfUse:
    """Return the points of use, by which causes of errors are weighed."""

    def __init__(self, estimate: Estimate) -> None:
        self.problem, self.by_parameters, self._back = derivatives_along(estimate, marked_rays(estimate))

    def effect(self, by_unknowns: Floats, values: Floats, covariance: Floats) -> Effect:
        """Return what unknowns of those values (k,) and covariance (k, k) do, which move the points as
        `by_unknowns` (n, 2, k) says, px per unit of each.
        """
        moved = by_unknowns @ values
        size = np.hypot(*moved.T)
        direction = moved / np.where(size > 0.0, size, 1.0)[:, None]
        along = np.einsum("nc,nck->nk", direction, by_unknowns)
        deviation = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", along, covariance, along), 0.0))
        spread = np.einsum("nck,kl,ndl->ncd", by_unknowns, covariance, by_unknowns)
        values_of_spread, axes = np.linalg.eigh(spread)
        widest = axes[..., -1] * np.sqrt(np.maximum(values_of_spread[..., -1], 0.0))[:, None]
        shrunk = np.maximum(1.0 - _SURE * deviation / np.where(size > 0.0, size, 1.0), 0.0)
        return Effect(self._over_limit(moved), self._over_limit(moved * shrunk[:, None]), self._over_limit(widest))

    def _over_limit(self, moved: Floats) -> float:
        px = np.hypot(*moved.T)
        mm = 1e3 * np.linalg.norm(np.einsum("nic,nc->ni", self._back, moved), axis=1)
        return over_limit(*(each.reshape(len(DISTANCES_M), -1) for each in (px, mm)))
