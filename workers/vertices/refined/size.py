"""The estimate of the board's size with its covariance, and whether it contradicts a size that was stated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.vertices.vertex import SizeFacts

Floats = NDArray[np.float64]
Edges = tuple[float, float]
TOLERANCE_M: Final = 0.003  # of a stated edge: read from a tape
_GROWTH_SIGMA_RAD: Final = 0.5e-3
_ANY_GROWTH: Final = 0.05  # share of the sensors whose edges bloom by anything within the grid (OS1-64: 8 mrad)
_GROWTHS_RAD: Final[Floats] = 1.0e-3 * np.linspace(-0.25, 10.0, 206)
LEAST_GROWTH_RAD: Final = 0.05e-3  # standard deviation: the grid's step
_TURNS, _FARTHEST = 8, 2.0  # of the joint climb, and how many steps each may go
_LEAST_BEND, _NO_GAIN = 0.05, 0.05  # log likelihood: less than chance
_CONTRADICTS: Final = 13.8  # chi-square of two edges: by chance 0.001


@dataclass(frozen=True, slots=True, eq=False)
class SizeEstimate:
    """Edges in metres and growth in radians as boards show them; what cannot be told is in the covariance.

    Attributes:
        covariance: (2, 2) of the edges, m^2.
        slack: metres, twice the standard deviation of an edge if the growth were known.
        measured: (3,) edges and growth without the growth's prior; information: (3, 3) covariance of these.
        prior: (G,) log prior of each of `_GROWTHS_RAD`.
    """

    edges: Edges
    covariance: Floats
    growth: float
    growth_sigma: float
    slack: float
    measured: Floats
    spread: Floats
    prior: Floats

    @classmethod
    def over_growth(cls, edges: Edges, growth: float, spread: Floats, soft: float) -> SizeEstimate:
        """Return the moments over all growths.

        A beam whose middle is on the board lies on it for the most part. So the middle of the step from hits to
        misses lies as far outside of the edge as half of its width ``soft`` (rad), or farther.

        Args:
            spread: (3, 3) covariance of edges and growth from the boards alone.
        """
        usual = growth_spread(soft)
        near = np.exp(-0.5 * ((_GROWTHS_RAD - soft) / usual) ** 2) / (usual * math.sqrt(2.0 * math.pi))
        prior = np.log((1.0 - _ANY_GROWTH) * near + _ANY_GROWTH / np.ptp(_GROWTHS_RAD))
        log = prior - 0.5 * (_GROWTHS_RAD - growth) ** 2 / spread[2, 2]
        weight = np.exp(log - np.logaddexp.reduce(log))
        slope = spread[:2, 2] / spread[2, 2]
        lengths = np.array(edges) + np.outer(_GROWTHS_RAD - growth, slope)
        fixed = spread[:2, :2] - np.outer(slope, slope) * spread[2, 2]
        mean, middle = weight @ lengths, float(weight @ _GROWTHS_RAD)
        apart = lengths - mean
        first, other = mean.tolist()
        return cls(
            (first, other),
            fixed + (apart.T * weight) @ apart,
            middle,
            math.sqrt(float(weight @ (_GROWTHS_RAD - middle) ** 2)),
            2.0 * math.sqrt(max(float(np.diag(fixed).max()), 0.0)),
            np.array([*edges, growth]),
            spread,
            prior,
        )

    def facts(self, stated: Edges) -> SizeFacts:
        """Return what is reported of the size; ``stated``: metres, 0 for an edge that is open."""
        (short, sigma), (long, other) = sorted(
            zip(self.edges, np.sqrt(np.diag(self.covariance)).tolist(), strict=True)
        )
        contradicts = all(stated) and min(self._chi2(stated), self._chi2(stated[::-1])) > _CONTRADICTS
        return SizeFacts((short, long), (sigma, other), contradicts)

    def _chi2(self, stated: Edges) -> float:
        """Return how much less likely the stated size is than the best one, each with the growth that suits it."""
        tolerant = self.spread + np.diag([TOLERANCE_M**2, TOLERANCE_M**2, 0.0])
        off = np.column_stack([np.tile(stated, (_GROWTHS_RAD.size, 1)), _GROWTHS_RAD]) - self.measured
        stated_cost = np.einsum("gi,gi->g", off, np.linalg.solve(tolerant, off.T).T) - 2.0 * self.prior
        free_cost = off[:, 2] ** 2 / self.spread[2, 2] - 2.0 * self.prior
        return float(stated_cost.min() - free_cost.min())


def growth_spread(soft: float) -> float:
    """Radians, standard deviation of the growth about the step's half width ``soft``, before boards tell."""
    return math.hypot(_GROWTH_SIGMA_RAD, 0.5 * soft)


def climb(
    value: Callable[[Floats], float], start: Floats, axes: Sequence[int], steps: Floats
) -> tuple[Floats, Floats, float]:
    """Maximise by Newton's method with a quadratic through points one step aside (Conn, Scheinberg and Vicente 2009).

    Returns:
        The optimum (N,); (N, N) inverse of the negative curvature there, 0 along all but ``axes``; the value.
    """
    best, highest = start.copy(), value(start)
    inverse = np.zeros((start.size, start.size))
    if not axes:
        return best, inverse, highest
    unit = np.diag(steps)[list(axes)]
    for _ in range(_TURNS):
        beside = np.array([[value(best + sign * u) for sign in (1.0, -1.0)] for u in unit])
        slope = 0.5 * (beside[:, 0] - beside[:, 1])
        bend = np.diag(2.0 * highest - beside.sum(axis=1))
        for a in range(len(unit)):
            for b in range(a):
                corner = value(best + unit[a] + unit[b])
                bend[a, b] = bend[b, a] = beside[a, 0] + beside[b, 0] - corner - highest
        curvature, axis = np.linalg.eigh(bend)
        inverse = unit.T @ (axis / np.maximum(curvature, _LEAST_BEND)) @ axis.T @ unit
        move = axis @ np.clip((axis.T @ slope) / np.maximum(curvature, _LEAST_BEND), -_FARTHEST, _FARTHEST)
        points = [best + move @ unit, *(best + s * u for u in unit for s in (1.0, -1.0))]
        values = [value(points[0]), *beside.ravel().tolist()]
        top = int(np.argmax(values))
        gain = values[top] - highest
        if gain > 0.0:
            best, highest = points[top], values[top]
        if gain < _NO_GAIN:
            break
    return best, inverse, highest
