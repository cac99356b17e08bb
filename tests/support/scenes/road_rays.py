"""Where rays over a simulated road end. Compiled."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from tests.support.scenes.road import Road

Floats = NDArray[np.float64]


def cast_rays(road: Road, origins: Floats, directions: Floats) -> tuple[Floats, Floats, Floats]:
    """Rays (N, 3) of unit length from origins (N, 3), world frame.

    Returns range (N,), infinite where nothing is met; albedo (N,); and cosine (N,) of the angle to the surface's
    normal.
    """
    count = len(directions)
    distance, albedo, cosine = np.full(count, np.inf), np.zeros(count), np.zeros(count)
    _cast(
        np.ascontiguousarray(origins), np.ascontiguousarray(directions), road.boxes, _circles(road.boxes), road.poles,
        road.paint, road.asphalt, distance, albedo, cosine,
    )  # fmt: skip
    return distance, albedo, cosine


def _circles(boxes: Floats) -> Floats:
    """(B, 3) circles seen from above that hold the boxes, a little wider: x and y of the middle, radius."""
    low, high = boxes[:, 0:4:2], boxes[:, 1:4:2]
    radius = 0.5 * np.linalg.norm(high - low, axis=1) * (1.0 + 1e-6) + 1e-6
    return np.column_stack([0.5 * (low + high), radius])


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _cast(
    origins: Floats, directions: Floats, boxes: Floats, circles: Floats, poles: Floats, paint: Floats, asphalt: float,
    distance: Floats, albedo: Floats, cosine: Floats,
) -> None:  # fmt: skip
    for i in range(directions.shape[0]):
        x, y, z = origins[i, 0], origins[i, 1], origins[i, 2]
        a, b, c = directions[i, 0], directions[i, 1], directions[i, 2]
        flat = math.sqrt(a * a + b * b)
        if c < -1e-6:
            hit = -z / c
            distance[i], cosine[i], albedo[i] = hit, -c, _ground(x + hit * a, y + hit * b, paint, asphalt)
        for j in range(boxes.shape[0]):
            dx, dy, reach = circles[j, 0] - x, circles[j, 1] - y, circles[j, 2] * flat
            along = dx * a + dy * b
            # Beside the box, behind the sensor, or behind what was met.
            if abs(dx * b - dy * a) > reach or along < -reach or along - reach > distance[i] * flat * flat:
                continue
            hit, axis = _box(x, y, z, a, b, c, boxes[j])
            if hit < distance[i]:
                distance[i], albedo[i] = hit, boxes[j, 6]
                cosine[i] = abs(a) if axis == 0 else (abs(b) if axis == 1 else abs(c))
        for j in range(poles.shape[0]):
            if abs((poles[j, 0] - x) * b - (poles[j, 1] - y) * a) > (poles[j, 2] + 1e-6) * flat:
                continue
            hit, facing = _pole(x, y, z, a, b, c, poles[j])
            if hit < distance[i]:
                distance[i], albedo[i], cosine[i] = hit, poles[j, 4], facing


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _ground(x: float, y: float, paint: Floats, asphalt: float) -> float:
    for k in range(paint.shape[0]):
        if paint[k, 0] <= x <= paint[k, 1] and paint[k, 2] <= y <= paint[k, 3]:
            return paint[k, 4]
    return asphalt


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _box(x: float, y: float, z: float, a: float, b: float, c: float, box: Floats) -> tuple[float, int]:
    """Distance to an axis-aligned box seen from outside, and the axis of the face."""
    enter, leave, axis = 0.0, math.inf, -1
    for k in range(3):
        at = x if k == 0 else (y if k == 1 else z)
        along = a if k == 0 else (b if k == 1 else c)
        if abs(along) < 1e-12:
            if at < box[2 * k] or at > box[2 * k + 1]:
                return math.inf, -1
            continue
        first, second = (box[2 * k] - at) / along, (box[2 * k + 1] - at) / along
        if first > second:
            first, second = second, first
        if first > enter:
            enter, axis = first, k
        leave = min(leave, second)
        if enter > leave:
            return math.inf, -1
    return (enter, axis) if axis >= 0 else (math.inf, -1)


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _pole(x: float, y: float, z: float, a: float, b: float, c: float, pole: Floats) -> tuple[float, float]:
    """Distance to an upright cylinder on the ground, and the cosine of the angle to its normal."""
    flat = math.sqrt(a * a + b * b)
    if flat < 1e-9:
        return math.inf, 0.0
    dx, dy = pole[0] - x, pole[1] - y
    along, across = (dx * a + dy * b) / flat, (dx * b - dy * a) / flat
    rest = pole[2] * pole[2] - across * across
    if along <= 0.0 or rest <= 0.0:
        return math.inf, 0.0
    hit = (along - math.sqrt(rest)) / flat
    height = z + hit * c
    if hit <= 0.0 or height < 0.0 or height > pole[3]:
        return math.inf, 0.0
    return hit, math.sqrt(rest) / pole[2] * flat
