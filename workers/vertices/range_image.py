# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
"""Range images: parts of a sweep with one row per ring and one column per shot, also where nothing returned.

A recording holds returns only. But the sensor fires at even steps, so the azimuth of a shot without a return follows
from its neighbours. Clusters of points, seen from above, decide where windows are opened.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from workers.readers.recording import Sweep
from workers.vertices.sensor_grid import MOST_RINGS, SensorGrid

Floats = NDArray[np.float64]
_CELL_M = 0.4
_MOST_RETURNS = 3000  # of a window without rings


def clusters(xy: Floats, cell_m: float) -> NDArray[np.int64]:
    """Return (N,) the cluster of each point (N, 2), from 0: cells of ``cell_m`` that touch, corners included."""
    cells, of_point = np.unique(np.floor(xy / cell_m), axis=0, return_inverse=True)
    touching = KDTree(cells).query_pairs(1.5, output_type="ndarray")
    graph = coo_array((np.ones(len(touching)), touching.T), (len(cells), len(cells)))
    numbers: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return numbers[of_point.reshape(-1)]


def cluster_sectors(xyz: NDArray[np.float32]) -> list[tuple[float, float]]:
    """Return azimuth of the middle and half the width, radians, of each cluster of points (N, 3) seen from above."""
    if not len(xyz):
        return []
    cell = np.unique(np.floor(xyz[:, :2].astype(np.float64) / _CELL_M), axis=0)
    label = clusters(cell + 0.5, 1.0)
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    result: list[tuple[float, float]] = []
    for number in range(int(label.max()) + 1):
        members = (cell[label == number][:, None, :] + corners[None, :, :]).reshape(-1, 2) * _CELL_M
        x, y = members.mean(axis=0).tolist()
        across = members[:, 1] * x - members[:, 0] * y
        half = float(np.abs(np.arctan2(across, members @ np.array([x, y]))).max())
        result.append((math.atan2(y, x), half))
    return result


_TWO_PI = 2.0 * math.pi
_BLOCK_RAD = math.radians(3.0)  # a motor wanders over tens of degrees


@dataclass(frozen=True, slots=True, eq=False)
class RangeImage:
    """The rays of a sweep around one azimuth.

    The window's own frame has x' horizontal towards the middle, y' left, z' up; its rays are
    (cos azimuth, sin azimuth, slope) times the horizontal distance. Rows go up and columns to the left, also where
    the sensor is upside down.

    Attributes:
        R_window_lidar: (3, 3) from the LiDAR frame to the window's.
        steps: (R,) radians between two shots of each ring.
        ring: (R,) of each row.
        azimuth: (R, C) radians from the middle; pi if there is no shot: beyond the window, or on rings that never
            returned anything.
        slope: (R, C) tangent of the elevation.
        distance: (R, C) horizontal metres, 0 if nothing returned.
        inside: (R, C) whether the return lies in the region.
        point: (R, C) index of the return in its sweep, -1 where there is none.
    """

    R_window_lidar: Floats
    steps: Floats
    ring: NDArray[np.int64]
    azimuth: Floats
    slope: Floats
    distance: Floats
    inside: NDArray[np.bool_]
    point: NDArray[np.int64]


def open_window(
    sweep: Sweep, inside: NDArray[np.bool_], grid: SensorGrid, centre: float, half_width: float
) -> RangeImage:
    """Return the rays within ``half_width`` (radians, at most 80 degrees) of the azimuth ``centre``.

    Args:
        inside: (N,) which points lie in the region.
    """
    elevation, shift, steps = _for_rings(sweep, grid)
    half = min(half_width, math.radians(80.0))
    c, s = math.cos(centre), math.sin(centre)
    image = _image(sweep.xyz, sweep.ring, inside, elevation, shift, steps, c, s, half)
    ring = np.arange(elevation.size)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    level = grid.R_level_lidar
    if level[2, 2] == 1.0:
        return RangeImage(turn, steps, ring, *image)
    ahead = level @ turn[0]
    if math.hypot(ahead[0], ahead[1]) < 1e-9:  # a sensor on its side that looks up or down
        ahead = level[:, 2]
    flat = math.hypot(ahead[0], ahead[1])
    c, s = ahead[0] / flat, ahead[1] / flat
    R_window_lidar = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ level
    azimuth, slope, distance, within, point = image
    azimuth, slope, distance = _levelled(azimuth, slope, distance, R_window_lidar @ turn.T)
    if level[2, 2] > 0.0:
        return RangeImage(R_window_lidar, steps, ring, azimuth, slope, distance, within, point)
    return RangeImage(
        R_window_lidar,
        steps[::-1].copy(),
        ring[::-1].copy(),
        azimuth[::-1, ::-1].copy(),
        slope[::-1, ::-1].copy(),
        distance[::-1, ::-1].copy(),
        within[::-1, ::-1].copy(),
        point[::-1, ::-1].copy(),
    )


def scattered_window(
    sweep: Sweep, inside: NDArray[np.bool_], R_level_lidar: Floats, centre: float, half_width: float, margin: float
) -> RangeImage:
    """Return a window as `open_window` of a sensor without rings: one row of its returns, in any order.

    Args:
        margin: radians to either side of ``half_width``; returns there count as outside of the region.
    """
    ahead = R_level_lidar @ np.array([math.cos(centre), math.sin(centre), 0.0])
    flat = max(math.hypot(ahead[0], ahead[1]), 1e-9)
    c, s = ahead[0] / flat, ahead[1] / flat
    R_window_lidar = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_level_lidar
    x, y, z = R_window_lidar @ sweep.xyz.astype(np.float64).T
    azimuth, distance = np.arctan2(y, x), np.hypot(x, y)
    off = np.abs(azimuth)
    (point,) = np.nonzero((off < min(half_width + margin, math.radians(80.0))) & (distance > 0.0))
    point = point[:: max(1, -(-point.size // _MOST_RETURNS))]
    slope, within = z[point] / distance[point], inside[point] & (off[point] <= half_width)
    row = (azimuth[None, point], slope[None], distance[None, point], within[None], point[None])
    return RangeImage(R_window_lidar, np.zeros(1), np.zeros(1, np.int64), *row)


def _levelled(azimuth: Floats, slope: Floats, distance: Floats, turn: Floats) -> tuple[Floats, Floats, Floats]:
    """Return azimuth, slope and horizontal distance in the axes to which ``turn`` (3, 3) leads."""
    none = azimuth == math.pi
    rays = np.stack([np.cos(azimuth), np.sin(azimuth), slope], axis=-1) @ turn.T
    flat = np.maximum(np.hypot(rays[..., 0], rays[..., 1]), 1e-9)
    turned = np.where(none, math.pi, np.arctan2(rays[..., 1], rays[..., 0]))
    return turned, np.where(none, 0.0, rays[..., 2] / flat), distance * flat


def _for_rings(sweep: Sweep, grid: SensorGrid) -> tuple[Floats, Floats, Floats]:
    """Return elevations, shifts and steps, extended to rings that the sweeps that taught the grid did not have."""
    further = (sweep.ring >= grid.elevation.size) & (sweep.ring < MOST_RINGS)
    if not further.any():
        return grid.elevation, grid.shift, grid.steps
    more = int(sweep.ring[further].max()) + 1 - grid.elevation.size
    above = sweep.xyz[further].astype(np.float64)
    highest = float(np.median(np.arctan2(above[:, 2], np.hypot(above[:, 0], above[:, 1]))))
    steps = np.arange(1, more + 1, dtype=np.float64) / more
    rising = grid.elevation[-1] + (highest - grid.elevation[-1]) * steps
    return (
        np.concatenate([grid.elevation, rising]),
        np.concatenate([grid.shift, np.zeros(more)]),
        np.concatenate([grid.steps, np.full(more, grid.steps[-1])]),
    )


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _image(
    xyz: NDArray[np.float32], ring: NDArray[np.uint16], inside: NDArray[np.bool_], elevation: Floats, shift: Floats,
    steps: Floats, c0: float, s0: float, half: float,
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_], NDArray[np.int64]]:  # fmt: skip
    rings = elevation.size
    reach = math.tan(half)
    indices = np.empty(ring.size, np.int64)
    angle = np.empty(ring.size)
    count = 0
    for i in range(ring.size):
        x, y = np.float64(xyz[i, 0]), np.float64(xyz[i, 1])
        along, across = x * c0 + y * s0, y * c0 - x * s0
        if ring[i] < rings and along > 0.0 and abs(across) <= reach * along:
            indices[count], angle[count] = i, math.atan2(across, along)
            count += 1
    indices, angle = indices[:count], angle[:count]
    advance = _motor_advance(angle, ring[indices], shift, steps, half)
    rate = _TWO_PI / steps
    cosine, sine = np.zeros(rings), np.zeros(rings)
    for j in range(count):
        r = ring[indices[j]]
        even = angle[j] - _advance_at(advance, angle[j], half)
        cosine[r] += math.cos(rate[r] * even)
        sine[r] += math.sin(rate[r] * even)
    phase = _ring_phases(cosine, sine, shift, steps)
    middle = math.ceil(half / steps.min()) + 1
    columns = 2 * middle + 1
    azimuth, slope = np.empty((rings, columns)), np.empty((rings, columns))
    for r in range(rings):
        for c in range(columns):
            if abs(c - middle) * steps[r] <= half + 2.0 * steps[r] and not math.isnan(elevation[r]):
                even = phase[r] + (c - middle) * steps[r]
                azimuth[r, c] = even + _advance_at(advance, even, half)
                slope[r, c] = math.tan(elevation[r])
            else:
                azimuth[r, c], slope[r, c] = math.pi, 0.0
    distance = np.zeros((rings, columns))
    within = np.zeros((rings, columns), np.bool_)
    point = np.full((rings, columns), -1, np.int64)
    for j in range(count):
        i = indices[j]
        r = np.int64(ring[i])
        c = math.floor((angle[j] - _advance_at(advance, angle[j], half) - phase[r]) / steps[r] + 0.5) + middle
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        h = math.sqrt(x * x + y * y)
        if 0 <= c < columns and h > 0.0 and (point[r, c] < 0 or h < distance[r, c]):
            azimuth[r, c], slope[r, c], distance[r, c] = angle[j], z / h, h
            within[r, c], point[r, c] = inside[i], i
    return azimuth, slope, distance, within, point


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _motor_advance(angle: Floats, ring: NDArray[np.uint16], shift: Floats, steps: Floats, half: float) -> Floats:
    """Return the radians by which the motor is ahead of even steps, at even places from ``-half`` to ``half``."""
    places = 2 * math.ceil(half / _BLOCK_RAD) + 1
    step = np.median(steps)
    cosine, sine = np.zeros(places), np.zeros(places)
    for j in range(angle.size):
        if steps[ring[j]] == step:
            index = round((angle[j] + half) / (2.0 * half) * (places - 1))
            turned = (angle[j] - shift[ring[j]]) * _TWO_PI / step
            cosine[index] += math.cos(turned)
            sine[index] += math.sin(turned)
    advance = np.zeros(places)
    middle = places // 2
    for direction in (1, -1):
        before, c, s = 0.0, cosine[middle], sine[middle]
        index = middle + direction
        while 0 <= index < places:
            # Between two places the motor wavers by less than half a step.
            if cosine[index] != 0.0 or sine[index] != 0.0:
                if c != 0.0 or s != 0.0:
                    further = math.atan2(sine[index] * c - cosine[index] * s, cosine[index] * c + sine[index] * s)
                    before += further * step / _TWO_PI
                c, s = cosine[index], sine[index]
            advance[index] = before
            index += direction
    return advance


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _advance_at(advance: Floats, angle: float, half: float) -> float:
    """Return the `_motor_advance` at an angle."""
    x = min(max((angle + half) / (2.0 * half), 0.0), 1.0) * (advance.size - 1)
    k = min(int(x), advance.size - 2)
    return advance[k] + (x - k) * (advance[k + 1] - advance[k])


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _ring_phases(cosine: Floats, sine: Floats, shift: Floats, steps: Floats) -> Floats:
    """Return the azimuth of each ring's grid modulo its step; rings without returns take that of similar rings."""
    phase = np.empty(shift.size)
    base, based_on = 0.0, 0.0
    for r in range(shift.size):
        rate = _TWO_PI / steps[r]
        if cosine[r] != 0.0 or sine[r] != 0.0:
            phase[r] = math.atan2(sine[r], cosine[r]) / rate
            continue
        if based_on != steps[r]:
            c, s = 0.0, 0.0
            for q in range(shift.size):
                if steps[q] == steps[r]:
                    c += cosine[q] * math.cos(rate * shift[q]) + sine[q] * math.sin(rate * shift[q])
                    s += sine[q] * math.cos(rate * shift[q]) - cosine[q] * math.sin(rate * shift[q])
            base, based_on = math.atan2(s, c) / rate, steps[r]
        phase[r] = base + shift[r]
    return phase
