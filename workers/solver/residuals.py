"""Residuals of a fit in double precision, with their analytic derivatives in the search's parameters."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from apexcal.geometry.se3 import SE3
from workers.geometry.models import FORM_ID
from workers.geometry.projections.table import PROJECTIONS
from workers.geometry.rotations import axes_of_euler, axes_of_vector, rotation_rows
from workers.solver.problem import FitProblem

Floats = NDArray[np.float64]


class _Projected(NamedTuple):
    """Pixels (N, 2), violation (N,), and d pixels by the point (N, 2, 3) and by the intrinsics (N, 2, n)."""

    pixels: Floats
    violation: Floats
    by_point: Floats
    by_intrinsics: Floats


def transform_of(problem: FitProblem, p: Floats) -> SE3:
    """T_camera_lidar of a parameter vector (D,)."""
    turn = search_rotation(FORM_ID[problem.search], p)
    R = turn if problem.search == "euler" else turn @ problem.nominal.R
    return SE3(problem.nominal.to_frame, problem.nominal.from_frame, R, p[3:6])


def predict(problem: FitProblem, p: Floats) -> tuple[Floats, Floats]:
    """Pixels (N, 2) and violation (N,) of the problem's points; the pixels are undefined where violation > 0."""
    points = np.empty_like(problem.points)
    pixels, violation = np.empty_like(problem.pixels), np.empty(len(points))
    move_points(FORM_ID[problem.search], p, problem.turned_points, points)
    PROJECTIONS[problem.model].project_into(p[6:].copy(), points, pixels, violation)
    return pixels, violation


def by_point(problem: FitProblem, p: Floats) -> Floats:
    """Derivative (N, 2, 3) of the pixels by the LiDAR points at p (D,), px per metre, LiDAR frame."""
    # How a pixel moves with t_camera_lidar is how it moves with the point in the camera's frame.
    J = residuals_and_jacobian(problem, p, walls=False)[1].reshape(-1, 2, len(p))
    return np.einsum("nij,jk->nik", J[:, :, 3:6], transform_of(problem, p).R)


def residuals_and_jacobian(
    problem: FitProblem, p: Floats, local: bool = False, walls: bool = True
) -> tuple[Floats, Floats]:
    """Residuals (2 N,) in px, interleaved u v, and their Jacobian (2 N, D) in the order of `problem.names`.

    With `local` the three rotation columns are for small turns about the camera's axes at p instead of the
    search's parameters; those have no singular point. Not weighted. A forbidden projection's two residuals carry
    its cost between them and have zero derivatives; without `walls` the formula is continued there instead, as a
    plain least squares does that knows of neither folds nor cameras' backs.
    """
    projection, form, k = PROJECTIONS[problem.model], FORM_ID[problem.search], p[6:].copy()
    n = len(problem.points)
    moved, residuals, jacobian = np.empty((n, 3)), np.empty(2 * n), np.zeros((2 * n, len(p)))
    projected = _Projected(np.empty((n, 2)), np.empty(n), np.empty((n, 2, 3)), np.empty((n, 2, len(k))))
    move_points(form, p, problem.turned_points, moved)
    projection.project_into(k, moved, projected.pixels, projected.violation)
    projection.jacobians_into(k, moved, projected.by_point, projected.by_intrinsics)
    axes = np.eye(3) if local else rotation_axes(form, p)
    _fill(projected, problem.pixels, moved - p[3:6], axes, problem.diagonal_px if walls else 0.0, residuals, jacobian)
    return residuals, jacobian


@njit(nogil=True, error_model="numpy", cache=True)
def search_rotation(form: int, p: Floats) -> Floats:
    """The search's rotation (3, 3): exp(w), or Rz(alpha) Ry(beta) Rx(gamma)."""
    rows = rotation_rows(form, p[0], p[1], p[2])
    R = np.empty((3, 3))
    for i in range(9):
        R[i // 3, i % 3] = rows[i]
    return R


@njit(nogil=True, error_model="numpy", cache=True)
def rotation_axes(form: int, p: Floats) -> Floats:
    """(3, 3): column i is the axis, in the camera frame, about which rotation parameter i turns (rad per unit)."""
    rows = axes_of_vector(p[0], p[1], p[2]) if form == 0 else axes_of_euler(p[0], p[1])
    axes = np.empty((3, 3))
    for i in range(9):
        axes[i // 3, i % 3] = rows[i]
    return axes


@njit(nogil=True, error_model="numpy", cache=True)
def move_points(form: int, p: Floats, points: Floats, out: Floats) -> None:
    """out (N, 3) = search rotation times points (N, 3), plus t."""
    R = search_rotation(form, p)
    for i in range(points.shape[0]):
        for j in range(3):
            out[i, j] = R[j, 0] * points[i, 0] + R[j, 1] * points[i, 1] + R[j, 2] * points[i, 2] + p[3 + j]


@njit(nogil=True, error_model="numpy", cache=True)
def _fill(
    projected: _Projected,
    marks: Floats,
    turned: Floats,
    axes: Floats,
    wall_px: float,
    residuals: Floats,
    jacobian: Floats,
) -> None:
    # turned (N, 3): the points as the search's rotation leaves them. wall_px: see above, 0 without walls.
    for i in range(marks.shape[0]):
        if wall_px > 0.0 and projected.violation[i] > 0.0:
            residuals[2 * i] = residuals[2 * i + 1] = wall_px * (1.0 + projected.violation[i]) / sqrt(2.0)
            continue
        x, y, z = turned[i, 0], turned[i, 1], turned[i, 2]
        for c in range(2):
            row = 2 * i + c
            P = projected.by_point[i, c]
            residuals[row] = projected.pixels[i, c] - marks[i, c]
            for j in range(3):
                a, b, d = axes[0, j], axes[1, j], axes[2, j]
                jacobian[row, j] = P[0] * (b * z - d * y) + P[1] * (d * x - a * z) + P[2] * (a * y - b * x)
                jacobian[row, 3 + j] = P[j]
            for j in range(projected.by_intrinsics.shape[2]):
                jacobian[row, 6 + j] = projected.by_intrinsics[i, c, j]
