"""Pieces of a sweep that could be a board or a person: upright, and no larger than somebody with a board.

Returns along a ring belong together if their ranges do not jump, stretches of neighbouring rings if one stands above
the other. Walls, cars and the ground make pieces that are too large.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.refined.planes import find_stretches
from workers.vertices.refined.window import RangeImage, open_window
from workers.vertices.sensor_grid import SensorGrid

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

WIDEST_M: Final = 2.2  # a person with a board held out
TALLEST_M: Final = 2.8
_SECTORS: Final = 4
_OVERLAP: Final = math.radians(20.0)  # somebody with a board 2.5 m away
_SIGMA_M: Final = 0.03  # data sheets
_FEWEST: Final = 8
_GAP_M: Final = 0.1


def upright_pieces(sweep: Sweep, inside: Mask, grid: SensorGrid) -> list[Mask]:
    """Masks (N,) of pieces of at least two rings among the points ``inside`` (N,), the largest first.

    A piece at the rim of a sector may be met twice.
    """
    half = math.pi / _SECTORS + _OVERLAP
    pieces: list[NDArray[np.int64]] = []
    for number in range(_SECTORS):
        window = open_window(sweep, inside, grid, (2 * number + 1) * math.pi / _SECTORS - math.pi, half)
        pieces += _pieces(window)
    pieces.sort(key=len, reverse=True)
    masks: list[Mask] = []
    for points in pieces:
        size = np.ptp(sweep.xyz[points], axis=0)
        if math.hypot(size[0], size[1]) <= WIDEST_M and size[2] <= TALLEST_M:
            mask = np.zeros(len(sweep.xyz), np.bool_)
            mask[points] = True
            masks.append(mask)
    return masks


def _pieces(window: RangeImage) -> list[NDArray[np.int64]]:
    """Numbers of the points of each piece."""
    stretches = find_stretches(window.azimuth, window.distance, window.inside, _SIGMA_M, window.steps)
    parent = list(range(len(stretches)))

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    for i, j in _stacked(stretches, window.slope):
        parent[root(i)] = root(j)
    members: dict[int, list[int]] = {}
    for i in range(len(stretches)):
        members.setdefault(root(i), []).append(i)
    pieces: list[NDArray[np.int64]] = []
    for numbers in members.values():
        rings = {int(stretches[i, 0]) for i in numbers}
        points = np.concatenate([_points(window, stretches[i]) for i in numbers])
        if len(rings) >= 2 and points.size >= _FEWEST:
            pieces.append(points)
    return pieces


def _points(window: RangeImage, stretch: Floats) -> NDArray[np.int64]:
    ring, first, last = (int(value) for value in stretch[:3])
    run = slice(first, last + 1)
    point = window.point[ring, run]
    return point[(point >= 0) & window.inside[ring, run]]


def _stacked(stretches: Floats, slope: Floats) -> list[tuple[int, int]]:
    """Pairs of stretches of neighbouring rings that stand one above the other, as those of one upright surface."""
    by_ring: dict[int, list[int]] = {}
    for i, ring in enumerate(stretches[:, 0].astype(int).tolist()):
        by_ring.setdefault(ring, []).append(i)
    pairs: list[tuple[int, int]] = []
    middle = slope.shape[1] // 2
    for ring, upper in by_ring.items():
        lower = by_ring.get(ring - 1, [])
        if not lower:
            continue
        rise = abs(float(slope[ring, middle] - slope[ring - 1, middle]))
        higher, other = stretches[upper], stretches[lower]
        away = np.abs(higher[:, None, 6] - other[None, :, 6])
        gap = np.maximum(other[None, :, 4] - higher[:, None, 5], higher[:, None, 4] - other[None, :, 5])
        # A board leans by slopes of up to 0.7.
        near = (away <= _GAP_M + 0.7 * rise * higher[:, None, 6]) & (gap <= _GAP_M)
        pairs += [(upper[i], lower[j]) for i, j in zip(*np.nonzero(near), strict=True)]
    return pairs
