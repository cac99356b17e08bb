"""How far distances lie about a plane: each by itself, and those of a ring together."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
MANY_RINGS = 3
_DEVIATION = 1.4826  # of a normal variable, over the median of its absolute value


class Spread(NamedTuple):
    """Variances of distances about a plane, square metres.

    Attributes:
        about: of all, without their long tails.
        within: the same within the rings.
        between: of the rings' own errors; its estimate may be negative.
        rings: how many.
    """

    about: float
    within: float
    between: float
    rings: int

    def own(self, noise: float) -> float:
        """Metres, standard deviation of the rings' own errors, from all points and the noise of each."""
        return math.sqrt(max(self.about - noise**2, 0.0) * self.rings / (self.rings - 2))


def spread_about(beyond: Floats, ring: NDArray[np.int64]) -> Spread | None:
    """One-way analysis of variance of points that lie ``beyond`` a plane fitted to them; None on fewer than 3 rings.

    Any two rings lie in one plane, whatever their biases: it takes two degrees of freedom of the rings' means.
    """
    count = np.bincount(ring).astype(np.float64)
    kept = (count > 1.0)[ring]
    count = count[count > 1.0]
    rings, points = count.size, float(count.sum())
    if rings < MANY_RINGS:
        return None
    about = (1.05 * _DEVIATION * float(np.median(np.abs(beyond)))) ** 2
    beyond, ring = beyond[kept], np.unique(ring[kept], return_inverse=True)[1]
    mean = np.bincount(ring, beyond) / count
    within = (_DEVIATION * float(np.median(np.abs(beyond - mean[ring])))) ** 2 * points / (points - rings)
    free = rings - 2
    between = float(count @ (mean - beyond.mean()) ** 2) / free
    between /= (1.0 - 2.0 / (9.0 * free)) ** 3  # median of chi-square (Wilson and Hilferty)
    on_each = (points - float(count @ count) / points) / (rings - 1)
    return Spread(about, within, (between - within) / on_each, rings)
