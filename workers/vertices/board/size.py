"""The board's size and its edge blooming: usual values, a joint estimate, and whether it contradicts a stated size.

A beam has a width, so a board looks larger than it is, by the same angle at every distance. Boards at one distance
show only the sum of size and blooming. Boards at several distances, and the blooming of usual sensors, separate them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.vertices.vertex import SizeFacts

Floats = NDArray[np.float64]
SOFT_DEG = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
BEAM_SIGMA_RAD = 1.5e-3  # data sheets: half of a beam of 3 mrad
BLOOMING_RAD = (-0.25e-3, 10.0e-3)
_BLOOMING_SIGMA_RAD = 0.5e-3


def usual_softness() -> Floats:
    """Return (K,) share of the sensors with each of the half widths `SOFT_DEG`: data sheets give half of a beam."""
    widths = np.radians(SOFT_DEG)
    # The table's widths are evenly spaced in their logarithm.
    share: Floats = widths * np.exp(-0.5 * ((widths - BEAM_SIGMA_RAD) / BEAM_SIGMA_RAD) ** 2)
    return share / share.sum()


def usual_blooming(measured: float, sigma: float, widths: Floats) -> tuple[float, float]:
    """Return blooming and its standard deviation, from boards of known size and from the softness of the edges.

    A beam whose middle is on the board lies on it for the most part. So the step from hits to misses begins at the
    edge or outside of it, and its middle lies as far out as half of its width, or farther. That half width is each of
    `SOFT_DEG` with shares ``widths`` (K,).

    Args:
        measured, sigma: radians, blooming as the boards show it, and its standard deviation.
    """
    softness = np.radians(SOFT_DEG)
    spread = np.hypot(_BLOOMING_SIGMA_RAD, 0.5 * softness)  # about the half width, before any board is seen
    variance = spread**2 + sigma**2
    with np.errstate(divide="ignore"):
        log = np.log(widths) - 0.5 * ((measured - softness) ** 2 / variance + np.log(variance))
    share = np.exp(log - np.logaddexp.reduce(log))
    blooming = np.clip(softness + spread**2 / variance * (measured - softness), *BLOOMING_RAD)
    mean = float(share @ blooming)
    return mean, math.sqrt(float(share @ ((spread * sigma) ** 2 / variance + (blooming - mean) ** 2)))


TOLERANCE_M: Final = 0.003  # of a stated edge: read from a tape
_TURNS, _FARTHEST = 8, 2.0  # of the joint climb, and how many steps each may go
_LEAST_BEND, _NO_GAIN = 0.05, 0.05  # log likelihood: less than chance
_CONTRADICTS: Final = 13.8  # chi-square of two edges: by chance 0.001


@dataclass(frozen=True, slots=True, eq=False)
class SizeEstimate:
    """Both edges (m) and the blooming (rad) as boards show them, together.

    Attributes:
        measured: (3,) from the boards alone.
        spread: (3, 3) its covariance; where all boards are equally far, only the sum of size and blooming is certain.
    """

    measured: Floats
    spread: Floats

    def usual(self) -> tuple[Floats, Floats]:
        """Return mean (3,) and covariance (3, 3) with the blooming that data sheets make likely: half of a beam."""
        gain = self.spread[:, 2] / (self.spread[2, 2] + BEAM_SIGMA_RAD**2)
        mean = self.measured + gain * (BEAM_SIGMA_RAD - self.measured[2])
        return mean, self.spread - np.outer(gain, self.spread[2])

    def facts(self, stated: tuple[float, float]) -> SizeFacts:
        """Return the size as it is reported; ``stated``: metres, 0 for an edge that is open."""
        mean, covariance = self.usual()
        sigmas = np.sqrt(np.diag(covariance)).tolist()
        (short, sigma), (long, other) = sorted(zip(mean[:2].tolist(), sigmas[:2], strict=True))
        orders = [np.array(order) for order in (stated, stated[::-1])] if all(stated) else []
        contradicts = min((_chi2(order, mean, covariance) for order in orders), default=0.0) > _CONTRADICTS
        replaces = contradicts and min(_chi2(order, self.measured, self.spread) for order in orders) > _CONTRADICTS
        return SizeFacts((short, long), (sigma, other), contradicts, replaces)


def _chi2(stated: Floats, mean: Floats, covariance: Floats) -> float:
    """Return chi-square of edges (2,) that a tape measured, with the blooming in `BLOOMING_RAD` that suits best."""
    precision = np.linalg.inv(covariance + np.diag([TOLERANCE_M**2, TOLERANCE_M**2, 0.0]))
    blooming = mean[2] - float(precision[2, :2] @ (stated - mean[:2])) / precision[2, 2]
    off = np.append(stated, min(max(blooming, BLOOMING_RAD[0]), BLOOMING_RAD[1])) - mean
    return float(off @ precision @ off)


def climb(
    value: Callable[[Floats], float], start: Floats, axes: Sequence[int], steps: Floats
) -> tuple[Floats, Floats, float]:
    """Maximise by Newton's method with a quadratic through points one step aside (Conn, Scheinberg and Vicente 2009).

    Returns:
        The optimum (N,); (N, N) inverse of the negative curvature there, 0 along all but ``axes``; the value.
    """
    best, highest, inverse = start.copy(), value(start), np.zeros((start.size, start.size))
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
        before = highest
        if values[top] > highest:
            best, highest = points[top], values[top]
        if highest < before + _NO_GAIN:
            break
    return best, inverse, highest
