"""Depth discontinuities of a sweep: where a near surface ends before a far one, or before nothing.

On a plane the inverse range is linear in the direction. So a discontinuity is where it changes by much more than it
does on either side, along a ring or from ring to ring; the ground's rings, far apart as they are, show none.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep

Floats = NDArray[np.float64]

# Relative depth steps below this are folds and noise: 2 cm of noise and bias at 2 m are 1 %.
_STEP: Final = 0.1
_NEAREST_M: Final = 1.0
_FARTHEST_M: Final = 60.0
# Where a sensor gets no return from this many directions in a row, there is sky or something that swallows light.
_NOTHING: Final = 3
_FEWEST: Final = 200


class DepthEdges(NamedTuple):
    """Directions in which near surfaces end, at the near surface's range.

    Attributes:
        points: (N, 3) metres, LiDAR frame, half way from the last near direction to the first far one.
        beyond: (N, 3), the same point turned to the far direction: the edge lies across the line between.
        offset_ns: (N,) when the near surface was measured, after the sweep's stamp.
    """

    points: Floats
    beyond: Floats
    offset_ns: NDArray[np.int64]


def depth_edges(sweep: Sweep) -> DepthEdges:
    """The discontinuities of a sweep along its rings and between neighbouring rings."""
    if len(sweep.xyz) < _FEWEST:
        return DepthEdges(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64))
    grid = _Grid(sweep)
    along, between = _ends(grid, 1), _ends(grid, 0)
    return DepthEdges(
        np.concatenate([along.points, between.points]),
        np.concatenate([along.beyond, between.beyond]),
        np.concatenate([along.offset_ns, between.offset_ns]),
    )


class _Grid:
    """A sweep by ring and column: inverse range (0 where nothing came back), and direction as azimuth, elevation."""

    def __init__(self, sweep: Sweep) -> None:
        points = sweep.xyz.astype(np.float64)
        azimuth = np.arctan2(points[:, 1], points[:, 0])
        flat = np.hypot(points[:, 0], points[:, 1])
        elevation = np.arctan2(points[:, 2], flat)
        ring = sweep.ring.astype(np.int64)
        order = np.lexsort((azimuth, ring))
        steps = np.diff(azimuth[order])[np.diff(ring[order]) == 0]
        # Twins and gaps lie outside of the middle half.
        step = float(np.median(steps[steps > 1e-5])) if np.any(steps > 1e-5) else 2.0 * np.pi
        columns = max(round(2.0 * np.pi / step), 8)
        column = np.floor((azimuth / (2.0 * np.pi) + 0.5) * columns).astype(np.int64) % columns
        shape = (int(ring.max()) + 1, columns)
        centres = ((np.arange(columns) + 0.5) / columns - 0.5) * 2.0 * np.pi
        self.azimuth = np.broadcast_to(centres, shape).copy()
        count = np.bincount(ring, minlength=shape[0])
        mean = np.bincount(ring, elevation, shape[0]) / np.maximum(count, 1)
        self.elevation = np.broadcast_to(mean[:, None], shape).copy()
        self.inverse = np.zeros(shape)
        self.azimuth[ring, column], self.elevation[ring, column] = azimuth, elevation
        self.inverse[ring, column] = 1.0 / np.maximum(np.hypot(flat, points[:, 2]), 1e-3)
        self.inverse[count == 0] = np.nan
        self.offset_ns = np.zeros(shape, np.int64)
        self.offset_ns[ring, column] = sweep.offset_ns
        self._fill_lone_gaps()

    def _fill_lone_gaps(self) -> None:
        """Dropouts, and columns that a jittering azimuth skipped, get what stands beside them in the ring."""
        for _ in range(_NOTHING - 1):
            q = self.inverse
            left, right = np.roll(q, 1, axis=1), np.roll(q, -1, axis=1)
            lone = (q == 0.0) & (left > 0.0) & ((right > 0.0) | (np.roll(q, -2, axis=1) > 0.0))
            self.inverse = np.where(lone, left, q)
            self.offset_ns = np.where(lone, np.roll(self.offset_ns, 1, axis=1), self.offset_ns)

    def directions(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Floats:
        a, e = self.azimuth[rows, columns], self.elevation[rows, columns]
        return np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _ends(grid: _Grid, axis: int) -> DepthEdges:
    """The discontinuities along an axis of the grid: 0 from ring to ring, 1 along."""
    q = grid.inverse
    step = np.roll(q, -1, axis) - q
    if axis == 0:
        step[-1] = np.nan
    size = np.abs(step)
    around = np.maximum(np.roll(size, 1, axis), np.roll(size, -1, axis))
    near = np.maximum(q, np.roll(q, -1, axis))
    # The lowest and highest pair of rings have a neighbour on one side only, and NaN compares as false.
    is_edge = (size - around > _STEP * near) & (near < 1.0 / _NEAREST_M) & (near > 1.0 / _FARTHEST_M)
    rows, columns = np.nonzero(is_edge)
    other = ((rows + 1) % q.shape[0], columns) if axis == 0 else (rows, (columns + 1) % q.shape[1])
    first, second = grid.directions(rows, columns), grid.directions(*other)
    is_first = (step[rows, columns] < 0.0)[:, None]
    range_m = 1.0 / near[rows, columns][:, None]
    middle = first + second
    middle *= range_m / np.linalg.norm(middle, axis=1)[:, None]
    offset_ns = np.where(is_first[:, 0], grid.offset_ns[rows, columns], grid.offset_ns[other])
    return DepthEdges(middle, np.where(is_first, second, first) * range_m, offset_ns)
