"""Velocities of the apex at the pairs' times, from the pairs near in time."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
_REACH_S: Final = 0.5  # within half a second a walker at 1.2 m/s hardly turns
_NEIGHBOURS: Final = 5  # on either side: as many as sweeps of 10 Hz in that time
_LEAST_SHARE: Final = 0.5


def velocities_of(points: ArrayLike, stamps_ns: ArrayLike) -> Floats | None:
    """(N, 3) m/s of points (N, 3) m at their stamps (N,), any order: the slope of the pairs within half a second.

    Zero for a pair without neighbours; None if half of the pairs have none.
    """
    order = np.argsort(np.asarray(stamps_ns, np.int64), kind="stable")
    times = np.asarray(stamps_ns, np.int64)[order]
    xyz = np.asarray(points, np.float64)[order]
    n = len(times)
    count, of_time, of_square = np.ones(n), np.zeros(n), np.zeros(n)
    of_place, of_both = np.zeros((n, 3)), np.zeros((n, 3))
    for step in (*range(-_NEIGHBOURS, 0), *range(1, _NEIGHBOURS + 1)):
        rows = np.arange(max(0, -step), min(n, n - step))
        gap = (times[rows + step] - times[rows]) * 1e-9
        near = np.abs(gap) <= _REACH_S
        rows, gap = rows[near], gap[near]
        moved = xyz[rows + step] - xyz[rows]
        count[rows] += 1.0
        of_time[rows] += gap
        of_square[rows] += gap**2
        of_place[rows] += moved
        of_both[rows] += gap[:, None] * moved
    spread = of_square - of_time**2 / count
    known = spread > 1e-6  # s^2: neighbours at one moment tell nothing
    if np.count_nonzero(known) < _LEAST_SHARE * n:
        return None
    slope = (of_both - of_time[:, None] * of_place / count[:, None]) / np.where(known, spread, 1.0)[:, None]
    found = np.empty((n, 3))
    found[order] = np.where(known[:, None], slope, 0.0)
    return found
