"""A board in the LiDAR's frame: its apex in angles and range, its time, and what stands around it."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.board.board_estimate import MOST_ON_BOARD, BoardEstimate
from workers.vertices.board.candidate import PlaneCandidate
from workers.vertices.board.model import BoardModel

Floats = NDArray[np.float64]


@nb.njit(nogil=True, cache=True, error_model="numpy")
def angles_of_point(
    R_window_lidar: Floats, w: Floats, covariance: Floats, at: Floats
) -> tuple[Floats, Floats, float, Floats]:
    """Return a point of a plane in the LiDAR frame, with its derivatives.

    Args:
        w: (3,) the plane, in the window's frame; covariance: (3, 3) of it.
        at: (2,) metres to the left and up.

    Returns:
        xyz (3,); (3, 2) derivatives of azimuth, elevation and range by ``at``; the variance of the range that the
        plane's own covariance causes; (3,) derivatives of azimuth, elevation and range if the point rises by a radian
        of its distance.
    """
    norm = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    n = w / norm
    flat = math.hypot(n[0], n[1])
    # e_left = z x n, e_up = n x e_left
    axes = np.zeros((3, 3))
    axes[0, 0], axes[1, 0] = -n[1] / flat, n[0] / flat
    axes[0, 1], axes[1, 1], axes[2, 1] = -n[2] * axes[1, 0], n[2] * axes[0, 0], flat
    apex = n / norm + at[0] * axes[:, 0] + at[1] * axes[:, 1]
    x, y, z = apex
    reach = math.sqrt(x * x + y * y + z * z)
    flat = math.hypot(x, y)
    axes[:, 2] = np.array([-x * z / flat, -y * z / flat, flat])
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += apex[i] * covariance[i, j] * apex[j]
    variance *= reach * reach
    turned = np.zeros((3, 3))
    xyz = np.zeros(3)
    for i in range(3):
        for j in range(3):
            xyz[i] += R_window_lidar[j, i] * apex[j]
            for k in range(3):
                turned[i, k] += R_window_lidar[j, i] * axes[j, k]
    x, y, z = xyz
    flat = math.hypot(x, y)
    moved = np.empty((3, 3))
    for k in range(3):
        a, b, c = turned[:, k]
        moved[0, k] = (x * b - y * a) / flat**2
        moved[1, k] = (flat * c - (x * a + y * b) * z / flat) / reach**2
        moved[2, k] = (x * a + y * b + z * c) / reach
    return xyz, moved[:, :2].copy(), variance, moved[:, 2].copy()


_HEAD_BESIDE_M = 0.35
_HEAD_BEHIND_M = (-0.15, 0.7)
_IN_FRONT_M = 0.15
_BOARD_BESIDE_M, _BOARD_ABOVE_M, _BOARD_BEFORE_M, _BOARD_POINTS = 0.5, 1.5, -0.8, 2
_OCCLUDED_RINGS = 0.25
# Spinning sensors' data sheets state ranges to 0.03 m, and to 0.1 m where a return is unusually strong or weak.
_ACCURACY_M = 0.1
_EDGES = 2.0


def apex_time(sweep: Sweep, candidate: PlaneCandidate, board: BoardEstimate) -> int:
    """Return the nanoseconds after the sweep's stamp at which the sensor looked along the apex's azimuth."""
    window, ends = candidate.window, candidate.ends
    runs = [(r, slice(first, last + 1)) for r, (first, last) in enumerate(ends.tolist()) if first >= 0]
    point = np.concatenate([window.point[run] for run in runs])
    azimuth = np.concatenate([window.azimuth[run] for run in runs])[point >= 0]
    offset = sweep.offset_ns[point[point >= 0]].astype(np.float64)
    apex = window.R_window_lidar @ board.xyz
    towards = math.atan2(apex[1], apex[0])
    away = azimuth - azimuth.mean()
    spread = float(away @ away)
    rate = float(away @ offset) / spread if spread > 0.0 else 0.0
    return round(float(offset.mean()) + rate * (towards - float(azimuth.mean())))


def flags_of(candidate: PlaneCandidate, board: BoardEstimate) -> tuple[str, ...]:
    """Return the flags (`apexcal.documents.detectors.FLAGS`) of what a person who confirms should look at."""
    behind, left, up = _around_apex(candidate, board)
    returned = candidate.window.distance > 0.0
    over = returned & candidate.window.inside & (up > 0.0) & (np.abs(left) < _HEAD_BESIDE_M)
    over &= (behind > _HEAD_BEHIND_M[0]) & (behind < _HEAD_BEHIND_M[1])
    head = bool(over.any())
    hidden, rings = 0, 0
    for r, (first, last) in enumerate(candidate.ends.tolist()):
        if first >= 0:
            rings += 1
            beside = [c for c in (first - 1, first - 2, last + 1, last + 2) if 0 <= c < behind.shape[1]]
            hidden += any(returned[r, c] and behind[r, c] < -_IN_FRONT_M for c in beside)
    occluded = hidden > _OCCLUDED_RINGS * rings
    return (*(["head_above"] if head else []), *(["occluded"] if occluded else []))


def is_overtopped(candidate: PlaneCandidate, board: BoardEstimate, model: BoardModel) -> bool:
    """Return whether something stands above the apex and in front of the plane: a body's plane below a board."""
    behind, left, up = _around_apex(candidate, board)
    over = (candidate.window.distance > 0.0) & candidate.window.inside & (np.abs(left) < _BOARD_BESIDE_M)
    # The beams that graze the board's own edges return from above its apex, and from before its plane.
    beside = _EDGES * (model.blooming + model.softness) * candidate.plane.rays.reach.mean()
    over &= (up > beside) & (up < _BOARD_ABOVE_M)
    # On few rings the plane may be the body's, close behind a board: then only the noise is allowed for.
    unusual = _ACCURACY_M if candidate.plane.extent.has_many_rings else 0.0
    over &= (behind > _BOARD_BEFORE_M) & (behind < -unusual - 4.0 * model.sigma)
    return int(np.count_nonzero(over)) >= _BOARD_POINTS


def _around_apex(candidate: PlaneCandidate, board: BoardEstimate) -> tuple[Floats, Floats, Floats]:
    """Return (R, C) metres: how far each return lies behind the plane, and its ray left of and above the apex."""
    window, w = candidate.window, candidate.plane.w
    inverse = w[0] * np.cos(window.azimuth) + w[1] * np.sin(window.azimuth) + w[2] * window.slope
    distance = 1.0 / np.maximum(inverse, 1e-3)
    apex = window.R_window_lidar @ board.xyz
    left = distance * np.sin(window.azimuth - math.atan2(apex[1], apex[0]))
    return window.distance - distance, left, distance * window.slope - apex[2]


def describe_candidate(board: BoardEstimate) -> str:
    """Return size, distance and ring count of the thing in the candidate's plane, for a person."""
    extent, hits = board.plane.extent, board.plane.returns.hits
    width, height = max(extent.width, 0.0), float(np.ptp(hits[1])) if hits.size else 0.0
    on = f"on {extent.rings} rings" if extent.rings else f"with {extent.points} returns"
    return f"a flat thing of {width:.1f} x {height:.1f} m at {float(np.linalg.norm(board.xyz)):.1f} m {on}"


def describe_objection(board: BoardEstimate, model: BoardModel, least_points: int) -> str:
    """Return the first way in which the thing differs from a board, with its figure, for a person."""
    plane, points, contradicting = board.plane, board.plane.extent.points, board.agreement.contradicting
    size = f"a board of {model.edges[0]:.2f} x {model.edges[1]:.2f} m"
    turned, leant = (math.degrees(math.atan(abs(slope))) for slope in (plane.w[1:] / plane.w[0]).tolist())
    off_upright = math.degrees(min(board.hold.fall % (0.5 * math.pi), -board.hold.fall % (0.5 * math.pi)))
    if not plane.has_usual_slopes or leant > 35.0 or turned > 60.0:
        why = (
            f"leaning {leant:.0f} degrees: boards lean up to 35"
            if leant > 35.0
            else f"turned by {turned:.0f} degrees from the sensor: boards are turned by up to 60"
        )
    elif not board.has_usual_hold:
        on_tip = "boards stand on their tip, unless --corner says otherwise"
        usual = "boards with level edges have upright ones" if model.upper_corner else on_tip
        why = f"with edges {off_upright:.0f} degrees from upright: {usual}"
    elif board.agreement.on_board_share < MOST_ON_BOARD:
        why = f"of whose returns {board.agreement.on_board_share:.0%} lie on {size}"
    elif not board.is_consistent:
        why = f"where {contradicting} of {points + contradicting} returns contradict {size}"
    elif points < least_points:
        why = f"with {points} returns: a board has {least_points} at least"
    else:
        why = f"leaning {leant:.0f} degrees, as likely clutter as {size}"
    return why
