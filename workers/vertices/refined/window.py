"""A part of a sweep as an image: one row per ring, one column per shot, also where nothing came back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.sensor_grid import MOST_RINGS, SensorGrid

Floats = NDArray[np.float64]
_TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The rays of a sweep around one azimuth.

    The window's own frame has x' along the azimuth ``centre`` (horizontal), y' left, z' up; its rays are
    (cos azimuth, sin azimuth, slope) times the horizontal distance.

    Attributes:
        centre: radians, azimuth of the middle in the LiDAR frame.
        azimuth: (R, C) radians from the middle.
        slope: (R, C) tangent of the elevation.
        distance: (R, C) horizontal metres, 0 where nothing came back.
        inside: (R, C) whether the return lies in the region.
        point: (R, C) index of the return in its sweep, -1 where there is none.
    """

    centre: float
    azimuth: Floats
    slope: Floats
    distance: Floats
    inside: NDArray[np.bool_]
    point: NDArray[np.int64]


def open_window(
    sweep: Sweep, inside: NDArray[np.bool_], grid: SensorGrid, centre: float, half_width: float
) -> Window:
    """The rays within ``half_width`` (radians, at most 80 degrees) of the azimuth ``centre``.

    Args:
        inside: (N,) which points lie in the region.
    """
    elevation, shift = _for_rings(sweep, grid)
    half = min(half_width, math.radians(80.0))
    image = _image(
        sweep.xyz, sweep.ring, inside, elevation, shift, grid.step, math.cos(centre), math.sin(centre), half
    )
    return Window(centre, *image)


def _for_rings(sweep: Sweep, grid: SensorGrid) -> tuple[Floats, Floats]:
    """Elevations and shifts, also of rings that the sweep has and the sweeps that taught the grid had not."""
    further = (sweep.ring >= grid.elevation.size) & (sweep.ring < MOST_RINGS)
    if not further.any():
        return grid.elevation, grid.shift
    more = int(sweep.ring[further].max()) + 1 - grid.elevation.size
    above = sweep.xyz[further].astype(np.float64)
    highest = float(np.median(np.arctan2(above[:, 2], np.hypot(above[:, 0], above[:, 1]))))
    steps = np.arange(1, more + 1, dtype=np.float64) / more
    rising = grid.elevation[-1] + (highest - grid.elevation[-1]) * steps
    return np.concatenate([grid.elevation, rising]), np.concatenate([grid.shift, np.zeros(more)])


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _image(
    xyz: NDArray[np.float32], ring: NDArray[np.uint16], inside: NDArray[np.bool_], elevation: Floats, shift: Floats,
    step: float, c0: float, s0: float, half: float,
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_], NDArray[np.int64]]:  # fmt: skip
    rings = elevation.size
    reach = math.tan(half)
    rate = _TWO_PI / step
    kept = np.empty(ring.size, np.int64)
    angle = np.empty(ring.size)
    count = 0
    cosine, sine = np.zeros(rings), np.zeros(rings)
    for i in range(ring.size):
        x, y = np.float64(xyz[i, 0]), np.float64(xyz[i, 1])
        along, across = x * c0 + y * s0, y * c0 - x * s0
        if ring[i] < rings and along > 0.0 and abs(across) <= reach * along:
            a = math.atan2(across, along)
            kept[count], angle[count] = i, a
            count += 1
            cosine[ring[i]] += math.cos(rate * a)
            sine[ring[i]] += math.sin(rate * a)
    phase = _ring_phases(cosine, sine, shift, step)
    middle = math.ceil(half / step) + 1
    columns = 2 * middle + 1
    azimuth, slope = np.empty((rings, columns)), np.empty((rings, columns))
    for r in range(rings):
        for c in range(columns):
            azimuth[r, c] = phase[r] + (c - middle) * step
            slope[r, c] = math.tan(elevation[r])
    distance = np.zeros((rings, columns))
    within = np.zeros((rings, columns), np.bool_)
    point = np.full((rings, columns), -1, np.int64)
    for j in range(count):
        i = kept[j]
        r = np.int64(ring[i])
        c = math.floor((angle[j] - phase[r]) / step + 0.5) + middle
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        h = math.sqrt(x * x + y * y)
        if 0 <= c < columns and h > 0.0 and (point[r, c] < 0 or h < distance[r, c]):
            azimuth[r, c], slope[r, c], distance[r, c] = angle[j], z / h, h
            within[r, c], point[r, c] = inside[i], i
    return azimuth, slope, distance, within, point


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _ring_phases(cosine: Floats, sine: Floats, shift: Floats, step: float) -> Floats:
    """Azimuth of each ring's grid modulo the step: its own where it has returns, else from those of the others."""
    rate = _TWO_PI / step
    c, s = 0.0, 0.0
    for r in range(shift.size):
        c += cosine[r] * math.cos(rate * shift[r]) + sine[r] * math.sin(rate * shift[r])
        s += sine[r] * math.cos(rate * shift[r]) - cosine[r] * math.sin(rate * shift[r])
    base = math.atan2(s, c) / rate
    phase = np.empty(shift.size)
    for r in range(shift.size):
        if cosine[r] != 0.0 or sine[r] != 0.0:
            phase[r] = math.atan2(sine[r], cosine[r]) / rate
        else:
            phase[r] = base + shift[r]
    return phase
