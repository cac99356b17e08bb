"""Velocities of the apex at the pairs' times, from the pairs near in time."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.pairs import NEIGHBOURS, REACH_NS, tells_motion

Floats = NDArray[np.float64]
_REACH_S: Final = REACH_NS * 1e-9
_FASTEST_M_S: Final = 3.0  # people walk at 0.5 to 1.6 m/s and run at 3
_NOISE_M: Final = 0.1  # a vertex is off by centimetres
_MOST_FAST: Final = 0.1


def velocities_of(points: ArrayLike, stamps_ns: ArrayLike, corners: Sequence[str] | None = None) -> Floats | None:
    """(N, 3) m/s of points (N, 3) m at their stamps (N,), any order: the slope of the pairs within half a second.

    If pairs are of several ``corners`` (N,) of a board, each corner has a track of its own. Zero for a pair without
    neighbours; None if more than half of the pairs have none (`tells_motion`), or a tenth of the steps is faster than
    people: still poses with made-up times.
    """
    xyz, stamps = np.asarray(points, np.float64), np.asarray(stamps_ns, np.int64)
    if not tells_motion(stamps.tolist(), corners):
        return None
    of = np.zeros(len(xyz), np.int64) if corners is None else np.unique(np.array(corners), return_inverse=True)[1]
    velocities, steps, fast = np.zeros_like(xyz), 0, 0
    for corner in range(int(of.max(initial=0)) + 1):
        rows = np.flatnonzero(of == corner)
        velocities[rows] = _slopes(xyz[rows], stamps[rows])
        order = rows[np.argsort(stamps[rows], kind="stable")]
        gap, way = np.diff(stamps[order]) * 1e-9, np.linalg.norm(np.diff(xyz[order], axis=0), axis=1)
        near = (gap > 0.0) & (gap <= _REACH_S)
        steps += np.count_nonzero(near)
        fast += np.count_nonzero(near & (way > _FASTEST_M_S * gap + _NOISE_M))
    return None if fast > _MOST_FAST * steps else velocities


def _slopes(points: Floats, stamps_ns: NDArray[np.int64]) -> Floats:
    """Velocities (N, 3); zero for a pair without neighbours."""
    order = np.argsort(stamps_ns, kind="stable")
    times, xyz = stamps_ns[order], points[order]
    n = len(times)
    count, of_time, of_square = np.ones(n), np.zeros(n), np.zeros(n)
    of_place, of_both = np.zeros((n, 3)), np.zeros((n, 3))
    for step in (*range(-NEIGHBOURS, 0), *range(1, NEIGHBOURS + 1)):
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
    determined = spread > 1e-6  # s^2: neighbours at one moment tell nothing
    slope = (of_both - of_time[:, None] * of_place / count[:, None]) / np.where(determined, spread, 1.0)[:, None]
    velocities = np.empty((n, 3))
    velocities[order] = np.where(determined[:, None], slope, 0.0)
    return velocities
