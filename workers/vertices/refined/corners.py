"""The other corners of a board of known size: from its apex along its edges, with their joint covariance."""

from __future__ import annotations

import math

import numpy as np

from apexcal.documents.corners import CORNERS
from workers.geometry.spherical import axes, to_xyz
from workers.vertices.refined.board_model import EDGE_M, Fix, Floats, Plane, Way
from workers.vertices.vertex import Corners

_COUNT = len(CORNERS)
_STEP = 1e-6  # of a difference quotient, relative


def corners_of(fix: Fix, most: float) -> Corners | None:
    """The corners besides the apex that the rays tell to ``most`` radians, azimuth and elevation together.

    A corner is the apex plus known lengths along both edges. So its errors come from apex, roll, plane and lengths.
    All else in the apex's own covariance moves the board as a whole, so all corners share it.
    """
    weights = [way.weight for way in fix.ways]
    places, spreads, floors = zip(*(_of_way(fix.plane, way) for way in fix.ways), strict=True)
    mean: Floats = np.average(places, axis=0, weights=weights)
    apart: Floats = np.array(places) - mean
    own = np.average(spreads, axis=0, weights=weights) + (apart.T * weights) @ apart
    joint = own + np.average(floors, axis=0, weights=weights)
    stated = to_xyz(fix.covariance[None], fix.xyz[None])[0]
    turn = fix.plane.R_window_lidar.T
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


def _blocks(inverse: Floats, joint: Floats) -> Floats:
    return np.einsum("iab,ibjc,jdc->iajd", inverse, joint.reshape(_COUNT, 3, _COUNT, 3), inverse)


def _of_way(plane: Plane, way: Way) -> tuple[Floats, Floats, Floats]:
    """For one way to hold the board: (12,) x, y, z of all corners in the window's frame; two (12, 12) covariances.

    The first is what the rays leave open: apex and roll in the plane, and the plane itself. The second is what they
    cannot tell: the lengths of the edges, how straight they are, and the errors of whole rings.
    """
    first, second = way.edges
    at: Floats = np.array([*way.mean, first, second, *plane.w])
    step = _STEP * np.array([1.0, 1.0, 1.0, 1.0, 1.0, *[np.linalg.norm(plane.w)] * 3])
    columns = [(_place(plane, at + shift) - _place(plane, at - shift)) for shift in np.diag(step)]
    J = np.column_stack(columns) / (2.0 * step)
    covariance = np.zeros((8, 8))
    covariance[:3, :3], covariance[5:, 5:] = way.covariance, plane.spread
    # Either end of an edge may err by EDGE_M. Both upper edges tell the roll.
    roll = 0.5 * EDGE_M**2 * (first**-2 + second**-2)
    floor = np.diag([0.0, 0.0, roll, EDGE_M**2, EDGE_M**2, 0.0, 0.0, 0.0])
    floor[5:, 5:] = plane.uneven
    return _place(plane, at), J @ covariance @ J.T, J @ floor @ J.T


def _place(plane: Plane, at: Floats) -> Floats:
    """Top, left, right and bottom corner, (12,) metres, of (left, up, fall, first edge, second edge, w).

    If the plane turns, it meets the ray to the apex at another place; the rays to the board's edges stay the same.
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
    """Foot of the sensor's perpendicular on the plane w . X = 1, and unit vectors in it: to the left and up."""
    norm = float(np.linalg.norm(w))
    n = w / norm
    e_left = np.array([-n[1], n[0], 0.0]) / math.hypot(n[0], n[1])
    return n / norm, e_left, np.cross(n, e_left)


def _not_negative(symmetric: Floats) -> Floats:
    """The nearest covariance: rounding may leave an eigenvalue just below zero."""
    size, axis = np.linalg.eigh(0.5 * (symmetric + symmetric.T))
    nearest: Floats = (axis * np.maximum(size, 0.0)) @ axis.T
    return nearest
