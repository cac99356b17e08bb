"""Where the beams of a sweep end: ray casting against the scene, the board and the people. Compiled."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.simulation.walker import HEAD_RADIUS_M, LEG_APART_M, LEG_RADIUS_M

# What a beam can meet; 0 is nothing.
GROUND, WALL, POLE, BOARD, PERSON, SECOND_PERSON, SPECKLE, BOX = range(1, 9)

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
def _ball(c: float, s: float, slope: float, x: float, y: float, z: float, radius: float) -> float:
    """Horizontal distance to a sphere, else inf."""
    norm = math.sqrt(1.0 + slope * slope)
    along = (x * c + y * s + z * slope) / norm
    rest = radius * radius - (x * x + y * y + z * z - along * along)
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


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _box(c: float, s: float, slope: float, ground: float, box: Floats) -> float:
    """Horizontal distance to an upright box (x, y, heading, half length, half width, low, high), else inf."""
    ch, sh = math.cos(box[2]), math.sin(box[2])
    enter, leave = 0.0, math.inf
    for axis in range(3):
        if axis == 0:
            at, rate, half = -(ch * box[0] + sh * box[1]), ch * c + sh * s, box[3]
        elif axis == 1:
            at, rate, half = sh * box[0] - ch * box[1], ch * s - sh * c, box[4]
        else:
            at, rate, half = -ground - 0.5 * (box[5] + box[6]), slope, 0.5 * (box[6] - box[5])
        if rate == 0.0:
            if abs(at) > half:
                return math.inf
            continue
        first, second = (-half - at) / rate, (half - at) / rate
        enter = max(enter, min(first, second))
        leave = min(leave, max(first, second))
    return enter if 0.0 < enter <= leave else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _body(c: float, s: float, slope: float, person: Floats, ground: float) -> float:
    """Horizontal distance to a person, a row of ``people`` in :func:`cast`, else inf."""
    x, y, height = person[0], person[1], person[4]
    hip, shoulder = ground + 0.47 * height, ground + height - 2.4 * HEAD_RADIUS_M
    hit = min(
        _cylinder(c, s, slope, x, y, person[5], hip, shoulder),
        _ball(c, s, slope, x, y, ground + height - HEAD_RADIUS_M, HEAD_RADIUS_M),
    )
    for side in (-LEG_APART_M, LEG_APART_M):
        leg = _cylinder(c, s, slope, x + side * person[2], y + side * person[3], LEG_RADIUS_M, ground, hip)
        hit = min(hit, leg)
    return hit


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _static(
    c: float, s: float, slope: float, lift: float, flat: Floats, poles: Floats, boxes: Floats
) -> tuple[float, int]:
    """Horizontal distance to ground, wall, pole or box, and which of them."""
    ground, wall_x, wall_half_width, wall_top = flat[0] - lift, flat[1], flat[2], flat[3] - lift
    hit = ground / slope if slope < 0.0 else math.inf
    surface = GROUND
    wall = wall_x / c
    if c > 0.0 and wall < hit and abs(wall * s) <= wall_half_width and wall * slope <= wall_top:
        hit, surface = wall, WALL
    for i in range(poles.shape[0]):
        x, y, radius, high = poles[i, 0], poles[i, 1], poles[i, 2], poles[i, 3]
        pole = _cylinder(c, s, slope, x, y, radius, ground, ground + high)
        if pole < hit:
            hit, surface = pole, POLE
    for i in range(boxes.shape[0]):
        box = _box(c, s, slope, ground, boxes[i])
        if box < hit:
            hit, surface = box, BOX
    return hit, surface


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _near(c: float, s: float, i: int, people: Floats) -> bool:
    """Whether the ray passes close to anybody."""
    nearest = math.inf
    for k in range(people.shape[0]):
        nearest = min(nearest, abs(people[k, i, 0] * s - people[k, i, 1] * c))
    return nearest < _NEAR_PERSON_M


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _ray(
    angle: float, elevation: float, lift: float, i: int, board: Floats, people: Floats, hands: Floats,
    lengths: Floats, flat: Floats, poles: Floats, boxes: Floats,
) -> tuple[float, int]:  # fmt: skip
    """Range and surface of one ray of column ``i``; infinite and 0 where it meets nothing."""
    c, s, slope = math.cos(angle), math.sin(angle), math.tan(elevation)
    hit, what = _static(c, s, slope, lift, flat, poles, boxes)
    ground = flat[0] - lift  # heights are counted from where the beam leaves the axis
    for k in range(people.shape[0]):
        if abs(people[k, i, 0] * s - people[k, i, 1] * c) >= _NEAR_PERSON_M:
            continue
        person = _body(c, s, slope, people[k, i], ground)
        if person < hit:
            hit, what = person, PERSON if k == 0 else SECOND_PERSON
        if k > 0:
            continue
        plate = _board(c, s, slope, lift, board[i, 0], board[i, 1], board[i, 2], lengths[0], lengths[1])
        if plate < hit:
            hit, what = plate, BOARD
        for n in range(hands.shape[1]):
            x, y, z, radius = hands[i, n, 0], hands[i, n, 1], hands[i, n, 2], hands[i, n, 3]
            hand = _ball(c, s, slope, x, y, z - lift, radius)
            if hand < hit:
                hit, what = hand, PERSON
    return hit * math.sqrt(1.0 + slope * slope), what if hit < math.inf else 0


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _beam(
    angle: float, elevation: float, lift: float, beam: Floats, i: int, board: Floats, people: Floats, hands: Floats,
    lengths: Floats, flat: Floats, poles: Floats, boxes: Floats,
) -> tuple[float, int]:  # fmt: skip
    """The return of a wide beam: of the nearest surface that enough of it meets. ``beam`` is as :func:`cast` says.

    Where surfaces do not mix, the range is that of the centre where the centre meets that surface too, else the mean
    of the rays that do. Where they mix, it is the mean of all rays that end within the mixing depth.
    """
    half_width, depth, least = beam[0], beam[1], beam[2] * (_RIM + 1)
    reach = np.empty(_RIM + 1)
    met = np.empty(_RIM + 1, np.int64)
    reach[0], met[0] = _ray(angle, elevation, lift, i, board, people, hands, lengths, flat, poles, boxes)
    for k in range(_RIM):
        turn = 2.0 * math.pi * k / _RIM
        side = half_width * math.cos(turn) / math.cos(elevation)
        rise = half_width * math.sin(turn)
        reach[k + 1], met[k + 1] = _ray(
            angle + side, elevation + rise, lift, i, board, people, hands, lengths, flat, poles, boxes
        )
    while True:
        first = int(np.argmin(reach))
        if reach[first] == math.inf:
            return math.inf, 0
        if depth == 0.0 and met[0] == met[first]:
            return reach[0], met[0]
        nearest, what = reach[first], met[first]
        total, count = 0.0, 0
        for k in range(_RIM + 1):
            if reach[k] < nearest + depth if depth > 0.0 else met[k] == what:
                total += reach[k]
                count += 1
        if count >= least:
            return total / count, met[0] if reach[0] < nearest + depth else what
        for k in range(_RIM + 1):
            if reach[k] < nearest + depth if depth > 0.0 else met[k] == what:
                reach[k] = math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy")
def cast(
    azimuth: Floats, elevation: Floats, lift: Floats, fired: NDArray[np.bool_], beam: Floats, board: Floats,
    people: Floats, hands: Floats, lengths: Floats, flat: Floats, poles: Floats, boxes: Floats,
) -> tuple[Floats, NDArray[np.int64]]:  # fmt: skip
    """Range and surface of every beam of a sweep; the people stand still while one column fires.

    Args:
        azimuth, elevation: (C, R) of each beam, radians, in the scene's level frame.
        lift: (R,) at which height the rings' beams leave the axis.
        fired: (C, R) which lasers fire in which columns.
        beam: half width (radians; 0: a beam is one ray), mixing depth (surfaces that lie less than this far apart
            give one return; 0: the nearer one alone) and least share of the beam that a surface needs to answer.
            Only beams near a person have a width.
        board: (C, 3, 3) apex, edge to the left, edge to the right.
        people: (P, C, 6) body x y, left x y, height, radius of the torso; the first carries the board.
        hands: (C, H, 4) centre and radius of what the first person has at the board's edges.
        lengths: (2,) of the board's edges, left and right; (0, 0): there is no board.
        flat: ground z, wall x, wall half width, wall top z.
        poles: (N, 4) x, y, radius, height.
        boxes: (N, 7) x, y, heading, half length, half width, low, high; heights above the ground.

    Returns:
        (C, R) metres, infinite where nothing is met; (C, R) surfaces, 0 there.
    """
    columns, rings = azimuth.shape
    distance = np.full((columns, rings), math.inf)
    surface = np.zeros((columns, rings), np.int64)
    for i in range(columns):
        for j in range(rings):
            if not fired[i, j]:
                continue
            angle, rise = azimuth[i, j], elevation[i, j]
            if beam[0] > 0.0 and _near(math.cos(angle), math.sin(angle), i, people):
                distance[i, j], surface[i, j] = _beam(
                    angle, rise, lift[j], beam, i, board, people, hands, lengths, flat, poles, boxes
                )
            else:
                distance[i, j], surface[i, j] = _ray(
                    angle, rise, lift[j], i, board, people, hands, lengths, flat, poles, boxes
                )
    return distance, surface
