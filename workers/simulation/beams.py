"""Where the beams of a sweep end: ray casting against the scene, the board and the people. Compiled."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.simulation.walker import HEAD_RADIUS_M, LEG_APART_M, LEG_RADIUS_M, TORSO_RADIUS_M

# What a beam can meet; 0 is nothing.
GROUND, WALL, POLE, BOARD, PERSON, SECOND_PERSON, SPECKLE = range(1, 8)

_NEAR_PERSON_M = 1.5  # beams that pass farther from a body meet neither it nor the board
_RIM = 8  # rays on the rim of a beam

Floats = NDArray[np.float64]


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _cylinder(c: float, s: float, slope: float, x: float, y: float, radius: float, low: float, high: float) -> float:
    """Horizontal distance at which the ray (c, s) with ``slope`` meets an upright cylinder, else inf."""
    along = x * c + y * s
    across = x * s - y * c
    rest = radius * radius - across * across
    if along <= 0.0 or rest <= 0.0:
        return math.inf
    hit = along - math.sqrt(rest)
    z = hit * slope
    return hit if low <= z <= high else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _head(c: float, s: float, slope: float, x: float, y: float, z: float) -> float:
    """Horizontal distance to the sphere of the head, else inf."""
    norm = math.sqrt(1.0 + slope * slope)
    along = (x * c + y * s + z * slope) / norm
    rest = HEAD_RADIUS_M * HEAD_RADIUS_M - (x * x + y * y + z * z - along * along)
    return (along - math.sqrt(rest)) / norm if rest > 0.0 and along > 0.0 else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _board(
    c: float, s: float, slope: float, lift: float, apex: Floats, edge_left: Floats, edge_right: Floats,
    long_left: float, long_right: float,
) -> float:  # fmt: skip
    """Horizontal distance to the board, a rectangle with a corner at the apex, else inf."""
    n0 = edge_left[1] * edge_right[2] - edge_left[2] * edge_right[1]
    n1 = edge_left[2] * edge_right[0] - edge_left[0] * edge_right[2]
    n2 = edge_left[0] * edge_right[1] - edge_left[1] * edge_right[0]
    high = apex[2] - lift
    hit = (n0 * apex[0] + n1 * apex[1] + n2 * high) / (n0 * c + n1 * s + n2 * slope)
    d0, d1, d2 = hit * c - apex[0], hit * s - apex[1], hit * slope - high
    p = d0 * edge_left[0] + d1 * edge_left[1] + d2 * edge_left[2]
    q = d0 * edge_right[0] + d1 * edge_right[1] + d2 * edge_right[2]
    inside = 0.0 <= p <= long_left and 0.0 <= q <= long_right
    return hit if hit > 0.0 and inside else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _body(c: float, s: float, slope: float, body: Floats, left: Floats, height: float, ground: float) -> float:
    """Horizontal distance to a person, else inf."""
    x, y = body[0], body[1]
    hip, shoulder = ground + 0.47 * height, ground + height - 2.4 * HEAD_RADIUS_M
    person = min(
        _cylinder(c, s, slope, x, y, TORSO_RADIUS_M, hip, shoulder),
        _head(c, s, slope, x, y, ground + height - HEAD_RADIUS_M),
    )
    for side in (-LEG_APART_M, LEG_APART_M):
        leg = _cylinder(c, s, slope, x + side * left[0], y + side * left[1], LEG_RADIUS_M, ground, hip)
        person = min(person, leg)
    return person


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _static(c: float, s: float, slope: float, lift: float, flat: Floats, poles: Floats) -> tuple[float, int]:
    """Horizontal distance to ground, wall or pole, and which of them."""
    ground, wall_x, wall_half_width, wall_top = flat[0] - lift, flat[1], flat[2], flat[3] - lift
    hit = ground / slope if slope < 0.0 else math.inf
    surface = 1
    wall = wall_x / c
    if c > 0.0 and wall < hit and abs(wall * s) <= wall_half_width and wall * slope <= wall_top:
        hit, surface = wall, 2
    for i in range(poles.shape[0]):
        x, y, radius, high = poles[i, 0], poles[i, 1], poles[i, 2], poles[i, 3]
        pole = _cylinder(c, s, slope, x, y, radius, ground, ground + high)
        if pole < hit:
            hit, surface = pole, 3
    return hit, surface


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _ray(
    angle: float, elevation: float, lift: float, i: int, board: Floats, walker: Floats, second: Floats,
    lengths: Floats, flat: Floats, poles: Floats,
) -> tuple[float, int]:  # fmt: skip
    """Range and surface of one ray of column ``i``; infinite and 0 where it meets nothing."""
    c, s, slope = math.cos(angle), math.sin(angle), math.tan(elevation)
    hit, what = _static(c, s, slope, lift, flat, poles)
    ground = flat[0] - lift  # heights are counted from where the beam leaves the axis
    if abs(walker[i, 0] * s - walker[i, 1] * c) < _NEAR_PERSON_M:
        person = _body(c, s, slope, walker[i, 0:2], walker[i, 2:4], walker[i, 4], ground)
        if person < hit:
            hit, what = person, 5
        plate = _board(c, s, slope, lift, board[i, 0], board[i, 1], board[i, 2], lengths[0], lengths[1])
        if plate < hit:
            hit, what = plate, 4
    if second.shape[0] > 0 and abs(second[i, 0] * s - second[i, 1] * c) < _NEAR_PERSON_M:
        person = _body(c, s, slope, second[i, 0:2], second[i, 2:4], second[i, 4], ground)
        if person < hit:
            hit, what = person, 6
    return hit * math.sqrt(1.0 + slope * slope), what if hit < math.inf else 0


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _beam(
    angle: float, elevation: float, lift: float, half_width: float, i: int, board: Floats, walker: Floats,
    second: Floats, lengths: Floats, flat: Floats, poles: Floats,
) -> tuple[float, int]:  # fmt: skip
    """The return of a beam of that half width (radians): the nearest surface that its centre or rim touches.

    Its range is that of the centre where the centre meets that surface too, else the mean of the rays that do.
    """
    centre, what = _ray(angle, elevation, lift, i, board, walker, second, lengths, flat, poles)
    rim = np.empty(_RIM)
    met = np.empty(_RIM, np.int64)
    nearest, first = centre, what
    for k in range(_RIM):
        turn = 2.0 * math.pi * k / _RIM
        side = half_width * math.cos(turn) / math.cos(elevation)
        rise = half_width * math.sin(turn)
        rim[k], met[k] = _ray(angle + side, elevation + rise, lift, i, board, walker, second, lengths, flat, poles)
        if rim[k] < nearest:
            nearest, first = rim[k], met[k]
    if first == what:
        return centre, what
    total, count = 0.0, 0
    for k in range(_RIM):
        if met[k] == first:
            total += rim[k]
            count += 1
    return total / count, first


@nb.njit(nogil=True, cache=True, error_model="numpy")
def cast(
    azimuth: Floats, behind: Floats, elevation: Floats, lift: Floats, half_width: float, board: Floats,
    walker: Floats, second: Floats, lengths: Floats, flat: Floats, poles: Floats,
) -> tuple[Floats, NDArray[np.int64]]:  # fmt: skip
    """Range and surface of every beam of a sweep; the people stand still while one column fires.

    Args:
        azimuth: (C,) of the columns, radians.
        behind: (R,) how much smaller each ring's azimuth is.
        elevation: (R,) radians.
        lift: (R,) at which height the rings' beams leave the axis.
        half_width: of a beam, radians; 0: a beam is one ray. Only beams near a person have a width.
        board: (C, 3, 3) apex, edge to the left, edge to the right.
        walker, second: (C, 5) body x y, left x y, height; ``second`` (0, 5) where there is none.
        lengths: (2,) of the board's edges, left and right.
        flat: ground z, wall x, wall half width, wall top z.
        poles: (P, 4) x, y, radius, height.

    Returns:
        (C, R) metres, infinite where nothing is met; (C, R) surfaces, 0 there.
    """
    columns, rings = azimuth.size, elevation.size
    distance = np.empty((columns, rings))
    surface = np.zeros((columns, rings), np.int64)
    for i in range(columns):
        for j in range(rings):
            angle = azimuth[i] - behind[j]
            c, s = math.cos(angle), math.sin(angle)
            near = abs(walker[i, 0] * s - walker[i, 1] * c) < _NEAR_PERSON_M or (
                second.shape[0] > 0 and abs(second[i, 0] * s - second[i, 1] * c) < _NEAR_PERSON_M
            )
            if half_width > 0.0 and near:
                distance[i, j], surface[i, j] = _beam(
                    angle, elevation[j], lift[j], half_width, i, board, walker, second, lengths, flat, poles
                )
            else:
                distance[i, j], surface[i, j] = _ray(
                    angle, elevation[j], lift[j], i, board, walker, second, lengths, flat, poles
                )
    return distance, surface
