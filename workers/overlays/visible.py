"""Which points of a sweep a camera sees, and where.

The pages do the same (``frontend/src/lib/overlay/visible.ts``); shared vectors hold both to it.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, radians, tan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Of points (N, 3), metres, LiDAR frame: pixels (N, 2), distances from the camera (N,) in metres, which have a pixel.
See = Callable[[Floats], tuple[Floats, Floats, NDArray[np.bool_]]]

# A surface that a ray meets at up to 80 degrees from its normal does not hide itself.
_SLANT: Final = tan(radians(80.0))
_MOST_CELLS_ACROSS: Final = 512
# Cells of patches that are spread out at once: 64 MB of indices.
_AT_ONCE: Final = 1 << 22


class Visible(NamedTuple):
    """Pixels (N, 2) and distances (N,) in metres of what is seen; how many more points the image holds that nearer
    ones hide."""

    pixels: Floats
    distance: NDArray[np.float32]
    hidden: int


def visible(points: NDArray[np.float32], rings: NDArray[np.integer], see: See, size: tuple[int, int]) -> Visible:
    """What the camera sees of a sweep, in the sweep's order.

    Each point stands for a patch of half the way to its neighbours in the sweep. A point is hidden if a patch covers
    it that is nearer to the camera by more than the patch may be deep.

    Args:
        points: (N, 3), metres, LiDAR frame, ordered by ring and within a ring as the sensor gave them.
        rings: (N,), from 0.
        see: the camera.
        size: width and height of the image, px.
    """
    width, height = size
    at = points.astype(np.float64)
    pixels, distance, good = see(at)
    # Pixels have (0, 0) at the centre of the first one.
    with np.errstate(invalid="ignore"):
        inside = (pixels > -0.5).all(1) & (pixels[:, 0] < width - 0.5) & (pixels[:, 1] < height - 0.5)
    held = good & (distance > 0.0) & inside
    azimuth, elevation = _spacing(at, rings)
    at, pixels, distance = at[held], pixels[held], distance[held]
    reach, deep = _patches(at, pixels, azimuth, elevation[rings[held]], see)
    cell = max(1.0, width / _MOST_CELLS_ACROSS)
    grid = _DepthGrid(ceil(width / cell), ceil(height / cell))
    grid.cover((pixels + 0.5) / cell, reach / cell, distance + _SLANT * deep)
    kept = distance.astype(np.float32)
    seen = kept <= grid.at((pixels + 0.5) / cell)
    return Visible(pixels[seen], kept[seen], int((~seen).sum()))


def _patches(at: Floats, pixels: Floats, azimuth: float, elevation: Floats, see: See) -> tuple[Floats, Floats]:
    """(N, 2) px, how far each point's patch reaches from its pixel; and half its larger side (N,), metres."""
    x, y, z = at.T
    level = np.hypot(x, y)
    distance = np.hypot(level, z)
    across, up = distance * azimuth / 2, distance * elevation / 2
    upright = level > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        tilt = z * up / (level * distance)
        along_ring = np.column_stack([x - y / level * across, y + x / level * across, z])
        from_ring = np.column_stack([x - x * tilt, y - y * tilt, z + level / distance * up])
    reach = np.zeros((len(at), 2))
    # The patch's half axes, along the ring and from ring to ring, as the camera sees them.
    for beside in (along_ring, from_ring):
        there, away, good = see(np.where(upright[:, None], beside, at))
        known = upright & good & (away > 0.0)
        reach[known] += np.abs(there[known] - pixels[known])
    return reach, np.maximum(across, up)


def _spacing(at: Floats, rings: NDArray[np.integer]) -> tuple[float, Floats]:
    """Angles between neighbours: along a ring, and from each ring to the farther one of its neighbours, radians."""
    turned = np.arctan2(at[:, 1], at[:, 0])
    steps = np.abs(np.diff(turned))[rings[1:] == rings[:-1]]
    steps = np.sort(steps[steps > 0.0])
    count = np.bincount(rings)
    sums = np.bincount(rings, weights=np.arctan2(at[:, 2], np.hypot(at[:, 0], at[:, 1])))
    filled = np.flatnonzero(count)
    means = sums[filled] / count[filled]
    order = np.argsort(means, kind="stable")
    gaps = np.concatenate([[0.0], np.diff(means[order]), [0.0]])
    elevation = np.zeros(len(count))
    elevation[filled[order]] = np.maximum(gaps[:-1], gaps[1:])
    return float(steps[len(steps) // 2]) if len(steps) else 0.0, elevation


class _DepthGrid:
    """In each cell the distance beyond which points are hidden."""

    def __init__(self, width: int, height: int) -> None:
        self._size = np.array([width, height])
        self._limits = np.full(width * height, np.inf, np.float32)

    def cover(self, places: Floats, reach: Floats, limits: Floats) -> None:
        """Patches about places (N, 2), cells."""
        first = np.clip(np.floor(places - reach), 0, self._size).astype(np.int64)
        last = np.clip(np.floor(places + reach), -1, self._size - 1).astype(np.int64)
        wide, high = np.maximum(last - first + 1, 0).T
        cells = np.cumsum(wide * high)
        start = 0
        while start < len(places):
            done = cells[start - 1] if start else 0
            end = max(start + 1, int(np.searchsorted(cells, done + _AT_ONCE, side="right")))
            some = slice(start, end)
            self._cover(first[some], wide[some], high[some], limits[some].astype(np.float32))
            start = end

    def _cover(
        self, first: NDArray[np.int64], wide: NDArray[np.int64], high: NDArray[np.int64], limits: NDArray[np.float32]
    ) -> None:
        counts = wide * high
        patch = np.repeat(np.arange(len(counts)), counts)
        within = np.arange(len(patch)) - np.repeat(np.cumsum(counts) - counts, counts)
        row, column = np.divmod(within, wide[patch])
        flat = (first[patch, 1] + row) * self._size[0] + first[patch, 0] + column
        np.minimum.at(self._limits, flat, limits[patch])

    def at(self, places: Floats) -> NDArray[np.float32]:
        """The limit in the cell of each place (N, 2)."""
        column, row = np.floor(places).astype(np.int64).T
        return self._limits[row * self._size[0] + column]
