"""What each ring of a sensor measures too much: a constant, which boards on many rings tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class RingMeans(NamedTuple):
    """The rings of one board beside its plane.

    Attributes:
        ring: (K,) numbers.
        rays: (K, 3) mean of (cos azimuth, sin azimuth, slope).
        distance: (K,) horizontal metres of the plane there.
        beyond: (K,) metres by which the ring's points lie behind the plane.
        points: (K,)
        w: (3,) 1/m, the plane.
    """

    ring: NDArray[np.int64]
    rays: Floats
    distance: Floats
    beyond: Floats
    points: Floats
    w: Floats


def ring_errors(
    boards: Sequence[RingMeans], count: int, noise: float, spread: float, slopes: tuple[float, float, float, float]
) -> tuple[Floats, Floats]:
    """Mean (count,) and variance (count,) of the posterior of each ring's constant error, metres.

    Boards and errors are fitted together. All planes share a common shift with the errors, and a common lean; their
    priors decide these.

    Args:
        noise: metres, standard deviation of a distance; spread: metres, of the rings' errors.
        slopes: mean and standard deviation of the planes' two slopes.
    """
    precision = np.eye(count) / spread**2
    towards = np.zeros(count)
    met = np.zeros(count, np.bool_)
    mean, deviation = np.array(slopes[0::2]), np.array(slopes[1::2])
    for board in boards:
        weight = board.points / noise**2
        by_plane = -(board.distance**2)[:, None] * board.rays
        w0 = board.w[0]
        slope = -board.w[1:] / w0
        by_slope = np.column_stack([-slope / w0, -np.eye(2) / w0]) / deviation[:, None]
        off = (slope - mean) / deviation
        weighed = weight[:, None] * by_plane
        solved = np.linalg.solve(by_plane.T @ weighed + by_slope.T @ by_slope, weighed.T)
        at = np.ix_(board.ring, board.ring)
        precision[at] += np.diag(weight) - weighed @ solved
        towards[board.ring] += weight * board.beyond - solved.T @ (weighed.T @ board.beyond - by_slope.T @ off)
        met[board.ring] = True
    covariance = np.linalg.inv(precision)
    return np.where(met, covariance @ towards, 0.0), np.diag(covariance).copy()
