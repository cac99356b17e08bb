"""The shapes of people, board and poles that are painted into camera frames, in metres, the farthest first."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from workers.simulation.walker import (
    HEAD_RADIUS_M,
    LEG_APART_M,
    LEG_RADIUS_M,
    TORSO_RADIUS_M,
    BodyPoses,
    Poses,
)

Floats = NDArray[np.float64]
Colour = tuple[int, int, int, int]  # BGR premultiplied with alpha, alpha
Shape = tuple[Floats, Colour]  # outline (K, 3) metres, LiDAR frame

_STEPS = 12  # points per board edge: a straight edge is a curve behind the lens
_POLE_STRIPS = 6
_UP = np.array([0.0, 0.0, 1.0])

_SHADOW: Colour = (0, 0, 0, 80)
_TROUSERS: Colour = (84, 58, 44, 255)
_JACKET: Colour = (70, 92, 40, 255)
_SLEEVE: Colour = (60, 80, 34, 255)
_SKIN: Colour = (142, 170, 214, 255)
_HAIR: Colour = (34, 42, 58, 255)
_BOARD: Colour = (24, 150, 250, 255)
_BOARD_INSET: Colour = (60, 196, 255, 255)
BOARD_COLOURS: tuple[Colour, ...] = (_BOARD, _BOARD_INSET)
# How much warmer than the air a thermal camera sees people: skin of 33 degrees C in air of 17, clothes by a quarter.
WARMER_K: dict[Colour, float] = {_TROUSERS: 3.0, _JACKET: 4.0, _SLEEVE: 4.0, _SKIN: 12.0, _HAIR: 6.0}
_POLE_BGR = np.array([150.0, 150.0, 146.0])


def figure(poses: Poses, index: int, ground_z: float, seen_from: Floats) -> list[Shape]:
    """Everyone and the board at the pose with that index, as a camera at ``seen_from`` (3,) sees them."""
    walker = BodyPoses(poses.body, poses.left, poses.height)
    shapes = [*_person(walker, index, ground_z, _grips(poses, index)), *_board(poses, index), *_hands(poses, index)]
    if poses.second is None:
        return shapes
    second = _person(poses.second, index, ground_z, _hanging(poses.second, index, ground_z))
    nearer = np.linalg.norm(poses.second.body[index] - seen_from[:2]) < np.linalg.norm(
        poses.apex[index, :2] - seen_from[:2]
    )
    return [*shapes, *second] if nearer else [*second, *shapes]


def pole(row: Floats, ground_z: float, seen_from: Floats) -> list[Shape]:
    """A pole (x, y, radius, height) in strips, lit from the left as the background's poles are."""
    towards = row[:2] - seen_from[:2]
    right = np.array([towards[1], -towards[0]]) / np.linalg.norm(towards)
    edges = row[2] * np.linspace(-1.0, 1.0, _POLE_STRIPS + 1)
    shapes: list[Shape] = []
    for start, end in pairwise(edges.tolist()):
        foot = [np.array([*(row[:2] + across * right), ground_z]) for across in (start, end)]
        light = 0.75 - 0.35 * (start + end) / 2.0 / row[2]
        blue, green, red = (round(float(value)) for value in light * _POLE_BGR)
        outline = np.array([foot[0], foot[1], foot[1] + row[3] * _UP, foot[0] + row[3] * _UP])
        shapes.append((outline, (blue, green, red, 255)))
    return shapes


def _person(person: BodyPoses, index: int, ground_z: float, hands: tuple[Floats, Floats]) -> list[Shape]:
    body, left, height = person.body[index], person.left[index], float(person.height[index])
    base = np.array([body[0], body[1], ground_z])
    side = np.array([left[0], left[1], 0.0])
    hip, neck = 0.47 * height, height - 2.2 * HEAD_RADIUS_M
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)[:, None]
    ring = np.cos(turn) * np.array([1.0, 0.0, 0.0]) + np.sin(turn) * np.array([0.0, 1.0, 0.0])
    shapes: list[Shape] = [(base + (0.25, 0.0, 0.0) + 0.42 * ring, _SHADOW)]
    for sign in (-1.0, 1.0):
        leg = base + sign * LEG_APART_M * side
        shapes.append((_limb(leg, leg + (hip + 0.05) * _UP, side, LEG_RADIUS_M), _TROUSERS))
    shapes.append((_torso(base, side, hip, neck), _JACKET))
    head = base + (height - HEAD_RADIUS_M) * _UP
    disc = np.cos(turn) * side + np.sin(turn) * _UP
    shapes.append((head + HEAD_RADIUS_M * disc, _HAIR))
    shapes.append((head - 0.025 * _UP + 0.85 * HEAD_RADIUS_M * disc, _SKIN))
    for sign, hand in zip((1.0, -1.0), hands, strict=True):
        shoulder = base + sign * 1.15 * TORSO_RADIUS_M * side + (neck - 0.08) * _UP
        shapes.append((_limb(shoulder, hand, _across(shoulder, hand, side), 0.045), _SLEEVE))
    return shapes


def _board(poses: Poses, index: int) -> list[Shape]:
    apex, edge_left, edge_right = poses.apex[index], poses.edge_left[index], poses.edge_right[index]
    return [
        (_rectangle(apex, edge_left, edge_right, poses.board_m, 0.0), _BOARD),
        (_rectangle(apex, edge_left, edge_right, poses.board_m, 0.09), _BOARD_INSET),
    ]


def _hands(poses: Poses, index: int) -> list[Shape]:
    turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)[:, None]
    disc = np.cos(turn) * poses.edge_left[index] + np.sin(turn) * poses.edge_right[index]
    return [(grip + 0.04 * disc, _SKIN) for grip in _grips(poses, index)]


def _grips(poses: Poses, index: int) -> tuple[Floats, Floats]:
    """Return where the hands hold the board: on the middle of its upper edges."""
    apex = poses.apex[index]
    return (
        apex + 0.6 * poses.board_m[0] * poses.edge_left[index],
        apex + 0.5 * poses.board_m[1] * poses.edge_right[index],
    )


def _hanging(person: BodyPoses, index: int, ground_z: float) -> tuple[Floats, Floats]:
    """Hands of somebody who carries nothing."""
    body, left = person.body[index], person.left[index]
    hip_z = ground_z + 0.45 * float(person.height[index])
    first, second = (np.array([*(body + sign * 1.35 * TORSO_RADIUS_M * left), hip_z]) for sign in (1.0, -1.0))
    return first, second


def _across(start: Floats, end: Floats, side: Floats) -> Floats:
    """A unit vector in the plane of side and up, at right angles to a limb."""
    along = end - start
    wide, high = float(along @ side), float(along[2])
    norm = max(np.hypot(wide, high), 1e-6)
    return (high * side - wide * np.array([0.0, 0.0, 1.0])) / norm


def _limb(start: Floats, end: Floats, across: Floats, radius: float) -> Floats:
    offset = radius * across
    return np.array([start - offset, start + offset, end + offset, end - offset])


def _torso(base: Floats, side: Floats, hip: float, neck: float) -> Floats:
    outline = (
        (-1.0, hip - 0.06),
        (1.0, hip - 0.06),
        (1.25, neck - 0.08),
        (0.5, neck),
        (-0.5, neck),
        (-1.25, neck - 0.08),
    )
    return np.array([base + TORSO_RADIUS_M * wide * side + high * _UP for wide, high in outline])


def _rectangle(
    apex: Floats, edge_left: Floats, edge_right: Floats, board_m: tuple[float, float], inset: float
) -> Floats:
    """Outline (4 * _STEPS, 3) of the board, or of the field ``inset`` metres inside it."""
    low, (high_left, high_right) = inset, (edge - inset for edge in board_m)
    corners = np.array([(low, low), (high_left, low), (high_left, high_right), (low, high_right)])
    part = np.arange(_STEPS)[:, None] / _STEPS
    outline = np.concatenate(
        [
            corner + part * (following - corner)
            for corner, following in zip(corners, np.roll(corners, -1, 0), strict=True)
        ]
    )
    return apex + outline[:, :1] * edge_left + outline[:, 1:] * edge_right
