"""The board's other corners: where the detector puts them, and where they are after the vertex was moved in time.

A corner is the apex plus known lengths along both edges. So its errors come from apex, roll, plane and lengths, and
all
corners of a board share most of them: one joint covariance holds what they share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from apexcal.documents.corners import CORNERS, CornerName
from workers.geometry.spherical import axes, to_spherical, to_xyz
from workers.vertices.board.board_estimate import BoardEstimate, PosteriorMode
from workers.vertices.board.candidate import Plane
from workers.vertices.board.model import EDGE_M
from workers.vertices.vertex import Corners, Floats, Vertex

_COUNT = len(CORNERS)
_STEP = 1e-6  # of a difference quotient, relative
_UNLIKELY = 0.05  # share of the posterior


def corners_of(board: BoardEstimate, most: float) -> Corners | None:
    """Return the other corners with ``most`` radians of deviation, azimuth and elevation together; None: none."""
    weights = [mode.weight for mode in board.hold.modes]
    places, spreads, floors = zip(*(_corners_of_mode(board.plane, mode) for mode in board.hold.modes), strict=True)
    mean: Floats = np.average(places, axis=0, weights=weights)
    apart: Floats = np.array(places) - mean
    own = np.average(spreads, axis=0, weights=weights) + (apart.T * weights) @ apart
    joint = own + np.average(floors, axis=0, weights=weights)
    stated = to_xyz(board.covariance[None], board.xyz[None])[0]
    turn = board.plane.R_window_lidar.T
    shared = _not_negative(turn.T @ stated @ turn - joint[:3, :3])
    joint += np.kron(np.ones((_COUNT, _COUNT)), shared)
    xyz = mean.reshape(_COUNT, 3) @ turn.T
    # Over azimuth, elevation and range of each corner.
    inverse = np.linalg.inv(axes(xyz)) @ turn
    own_blocks, stated = (_blocks(inverse, part) for part in (own, joint))
    variance = np.einsum("iaia->ia", own_blocks)
    precise = [k for k in range(1, _COUNT) if math.sqrt(variance[k, 0] + variance[k, 1]) <= most]
    if not precise:
        return None
    chosen = [0, *precise]
    covariance = stated[np.ix_(chosen, range(3), chosen, range(3))].reshape(3 * len(chosen), 3 * len(chosen))
    return Corners.of([CORNERS[k] for k in precise], xyz[precise], covariance)


def corner_chi_square(first: BoardEstimate, other: BoardEstimate, sways_m: float) -> float:
    """Return the chi-square (of three) by which the worst corner of two boards lies apart, over the likeliest modes.

    ``sways_m``: standard deviation of a corner of a board that somebody holds still.
    """

    def places(board: BoardEstimate) -> list[tuple[Floats, Floats]]:
        turn = np.kron(np.eye(_COUNT), board.plane.R_window_lidar.T)
        modes = [_corners_of_mode(board.plane, mode) for mode in board.hold.modes if mode.weight > _UNLIKELY]
        return [(turn @ at, turn @ own @ turn.T) for at, own, _ in modes]

    def worst(at: Floats, own: Floats, there: Floats, others: Floats) -> float:
        off = (there - at).reshape(_COUNT, 3)
        both = own + others + sways_m**2 * np.eye(3 * _COUNT)
        blocks = [both[k : k + 3, k : k + 3] for k in range(0, 3 * _COUNT, 3)]
        return max(float(d @ np.linalg.solve(block, d)) for d, block in zip(off, blocks, strict=True))

    return min(worst(*a, *b) for a in places(first) for b in places(other))


def _blocks(inverse: Floats, joint: Floats) -> Floats:
    return np.einsum("iab,ibjc,jdc->iajd", inverse, joint.reshape(_COUNT, 3, _COUNT, 3), inverse)


def _corners_of_mode(plane: Plane, mode: PosteriorMode) -> tuple[Floats, Floats, Floats]:
    """Return, for one mode, x, y, z of all corners in the window's frame (12,), and two covariances (12, 12).

    The first comes from the rays: apex and roll in the plane, and the plane itself. The second is what the rays
        cannot
    show: the lengths of the edges, how straight they are, and the errors of whole rings.
    """
    first, second = mode.edges
    at: Floats = np.array([*mode.mean, first, second, *plane.w])
    step = _STEP * np.array([1.0, 1.0, 1.0, 1.0, 1.0, *[np.linalg.norm(plane.w)] * 3])
    columns = [(_corner_xyz(plane, at + shift) - _corner_xyz(plane, at - shift)) for shift in np.diag(step)]
    J = np.column_stack(columns) / (2.0 * step)
    covariance = np.zeros((8, 8))
    covariance[:3, :3], covariance[5:, 5:] = mode.covariance, plane.covariance
    # Either end of an edge may err by EDGE_M. Both upper edges determine the roll.
    roll = 0.5 * EDGE_M**2 * (first**-2 + second**-2)
    floor = np.diag([0.0, 0.0, roll, EDGE_M**2, EDGE_M**2, 0.0, 0.0, 0.0])
    floor[5:, 5:] = plane.ring_covariance
    return _corner_xyz(plane, at), J @ covariance @ J.T, J @ floor @ J.T


def _corner_xyz(plane: Plane, at: Floats) -> Floats:
    """Return top, left, right and bottom corner, (12,) metres, of (left, up, fall, first edge, second edge, w).

    If the plane turns, it meets the ray to the apex elsewhere; the rays to the board's edges stay the same.
    """
    foot, e_left, e_up = _frame(plane.w)
    ray = foot + at[0] * e_left + at[1] * e_up
    apex = ray / float(at[5:] @ ray)
    _, e_left, e_up = _frame(at[5:])
    cosine, sine = math.cos(at[2]), math.sin(at[2])
    first = at[3] * (cosine * e_left - sine * e_up)
    second = at[4] * (-sine * e_left - cosine * e_up)
    return np.concatenate([apex, apex + first, apex + second, apex + first + second])


def _frame(w: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the foot of the sensor's perpendicular on the plane w . X = 1, and unit vectors left and up in it."""
    norm = float(np.linalg.norm(w))
    n = w / norm
    e_left = np.array([-n[1], n[0], 0.0]) / math.hypot(n[0], n[1])
    return n / norm, e_left, np.cross(n, e_left)


def _not_negative(symmetric: Floats) -> Floats:
    """Return the nearest covariance: rounding may leave an eigenvalue just below zero."""
    size, axis = np.linalg.eigh(0.5 * (symmetric + symmetric.T))
    nearest: Floats = (axis * np.maximum(size, 0.0)) @ axis.T
    return nearest


Narrow = Callable[[Floats, Floats], Floats]


class MovedCorner(NamedTuple):
    """A corner at another moment: (3,) metres, LiDAR frame; (3, 3) over azimuth (rad), elevation (rad), range (m)."""

    name: CornerName
    xyz: Floats
    covariance: Floats


def move_corners(vertex: Vertex, xyz: Floats, covariance: Floats) -> list[MovedCorner]:
    """Return the corners of a vertex that was moved to ``xyz`` (3,), with the covariance (3, 3) that it has there.

    The board keeps its attitude. The error of a corner's offset from the apex correlates with the error of the apex
    in its own sweep. Where other sweeps reduced that error, only the rest counts: along each axis the smaller
    variance of the sweep's own and the track's.
    """
    if vertex.corners is None:
        return []
    joint = _joint_xyz(vertex)
    own: Floats = joint[0, :, 0, :]
    there = axes(xyz[None])[0]
    P = there @ covariance @ there.T
    # In axes where the sweep's own covariance is the unit matrix and the track's is diagonal.
    root: Floats = np.asarray(np.linalg.cholesky(own), np.float64)
    inverse: Floats = np.asarray(np.linalg.inv(root), np.float64)
    size, axis = np.linalg.eigh(inverse @ P @ inverse.T)
    half = root @ axis
    left: Floats = (half * np.minimum(size, 1.0)) @ half.T
    gain = inverse.T @ inverse @ left
    moved_corners: list[MovedCorner] = []
    for index, (name, corner) in enumerate(zip(vertex.corners.names, vertex.corners.xyz, strict=True), start=1):
        at = xyz + np.array(corner) - np.array(vertex.xyz)
        cross: Floats = joint[index, :, 0, :] - own
        both = cross @ gain
        spread = P + both + both.T + joint[index, :, index, :] - cross - cross.T - own
        moved_corners.append(MovedCorner(name, at, to_spherical(spread[None], at[None])[0]))
    return moved_corners


def mean_corners(vertices: Sequence[Vertex], narrowed: Narrow) -> Corners | None:
    """Return the mean corners of some sweeps of one still pose: those that all of them have; None if there are none.

    Args:
        narrowed: returns the covariance (3, 3) of a mean over x, y, z, from the mean covariance that the sweeps state
            and from the sweeps' values (N, 3). The correlations between corners are scaled in the same way.
    """
    with_corners = [vertex.corners for vertex in vertices if vertex.corners is not None]
    if not with_corners or len(with_corners) < len(vertices):
        return None
    names: list[CornerName] = [
        name for name in with_corners[0].names if all(name in corners.names for corners in with_corners)
    ]
    if not names:
        return None
    places: Floats = np.array(
        [
            [vertex.xyz, *(corners.xyz[corners.names.index(name)] for name in names)]
            for vertex, corners in zip(vertices, with_corners, strict=True)
        ]
    )
    joint: Floats = np.mean([_joint_covariance(corners, names) for corners in with_corners], axis=0)
    middle: Floats = places.mean(axis=0)
    scaled = np.zeros_like(joint)
    for k, at in enumerate(axes(middle)):
        block = slice(3 * k, 3 * k + 3)
        stated: Floats = at @ joint[block, block] @ at.T
        after: Floats = np.asarray(np.linalg.cholesky(narrowed(stated, places[:, k])), np.float64)
        before: Floats = np.asarray(np.linalg.cholesky(stated), np.float64)
        scaled[block, block] = np.linalg.inv(at) @ after @ np.linalg.inv(before) @ at
    return Corners.of(names, middle[1:], scaled @ joint @ scaled.T)


def _joint_xyz(vertex: Vertex) -> Floats:
    """Return the covariance (K, 3, K, 3) over x, y, z of the apex and its corners."""
    assert vertex.corners is not None
    at = axes(np.array([vertex.xyz, *vertex.corners.xyz]))
    joint = np.array(vertex.corners.covariance).reshape(len(at), 3, len(at), 3)
    return np.einsum("iab,ibjc,jdc->iajd", at, joint, at)


def _joint_covariance(corners: Corners, names: Sequence[CornerName]) -> Floats:
    """Return the joint covariance of the apex and these corners."""
    positions = np.array([0, *(1 + corners.names.index(name) for name in names)])
    rows = np.add.outer(3 * positions, np.arange(3)).ravel()
    return np.array(corners.covariance)[np.ix_(rows, rows)]
