"""Velocities of the apex at the pairs' times, from the pairs near in time."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
_REACH_S: Final = 0.5  # within half a second a walker at 1.2 m/s hardly turns
_NEIGHBOURS: Final = 5  # on either side: as many as sweeps of 10 Hz in that time
_LEAST_SHARE: Final = 0.5


def velocities_of(points: ArrayLike, stamps_ns: ArrayLike, corners: Sequence[str] | None = None) -> Floats | None:
    """(N, 3) m/s of points (N, 3) m at their stamps (N,), any order: the slope of the pairs within half a second.

    Where pairs are of several ``corners`` (N,) of a board, each is followed by itself. Zero for a pair without
    neighbours; None if half of the pairs have none.
    """
    xyz, stamps = np.asarray(points, np.float64), np.asarray(stamps_ns, np.int64)
    of = np.zeros(len(xyz), np.int64) if corners is None else np.unique(np.array(corners), return_inverse=True)[1]
    found, known = np.zeros_like(xyz), np.zeros(len(xyz), np.bool_)
    for corner in range(int(of.max(initial=0)) + 1):
        rows = np.flatnonzero(of == corner)
        found[rows], known[rows] = _slopes(xyz[rows], stamps[rows])
    return found if np.count_nonzero(known) >= _LEAST_SHARE * len(xyz) else None


def _slopes(points: Floats, stamps_ns: NDArray[np.int64]) -> tuple[Floats, NDArray[np.bool_]]:
    """Velocities (N, 3), and which have neighbours."""
    order = np.argsort(stamps_ns, kind="stable")
    times, xyz = stamps_ns[order], points[order]
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
    slope = (of_both - of_time[:, None] * of_place / count[:, None]) / np.where(known, spread, 1.0)[:, None]
    found, told = np.empty((n, 3)), np.empty(n, np.bool_)
    found[order], told[order] = np.where(known[:, None], slope, 0.0), known
    return found, told
