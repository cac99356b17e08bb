"""The equidistant fisheye: theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).

Kannala and Brandt 2006; cv2.fisheye.projectPoints. It sees beyond 90 degrees.
"""

from math import cos, hypot, sin, sqrt
from typing import Final

import numpy as np
from numba import njit

from workers.geometry.fold_radius import first_zero, grown_radius
from workers.geometry.linear_cameras import radial_alignment_start
from workers.geometry.polar_angle import polar_angle
from workers.geometry.projections.record import FUSED, Floats, Projected, Projection, Scalar
from workers.geometry.projections.single_precision import (
    VECTOR,
    ZERO,
    Box,
    Flag,
    Singles,
    Targets,
    distance_of,
    mount_rows,
    place_individual,
)


@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def kannala_brandt_fold(k1: float, k2: float, k3: float, k4: float) -> float:
    """theta in radians at which theta_d stops growing, pi where it never does."""
    S = np.pi * np.pi
    x = first_zero(3.0 * k1 * S, 5.0 * k2 * S**2, 7.0 * k3 * S**3, 9.0 * k4 * S**4)
    return np.pi * sqrt(x) if x < 1.0 else np.pi


@njit(nogil=True, error_model="numpy", fastmath=FUSED, forceinline=True)
def kannala_brandt_point(
    x: Scalar,
    y: Scalar,
    z: Scalar,
    f_x: Scalar,
    f_y: Scalar,
    c_x: Scalar,
    c_y: Scalar,
    k1: Scalar,
    k2: Scalar,
    k3: Scalar,
    k4: Scalar,
    fold_theta: Scalar,
) -> Projected:
    """One point's pixel and violation; `fold_theta` comes from `kannala_brandt_fold`, once per set of parameters."""
    tiny = type(z)(1e-12)
    r = sqrt(x * x + y * y)
    theta = polar_angle(r, z)
    t2 = theta * theta
    theta_d = theta + theta * (t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    # On the axis theta_d / r is 1 / z, and there is nothing to scale.
    scale = theta_d / max(r, tiny)
    past = theta - fold_theta
    violation = past if past > 0 else type(z)(0.0)
    return f_x * (x * scale) + c_x, f_y * (y * scale) + c_y, violation


@njit(nogil=True, error_model="numpy", cache=True)
def _project_into(k: Floats, points: Floats, pixels: Floats, violation: Floats) -> None:
    fold_theta = kannala_brandt_fold(k[4], k[5], k[6], k[7])
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1], violation[i] = kannala_brandt_point(
            points[i, 0], points[i, 1], points[i, 2], k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], fold_theta
        )


@njit(nogil=True, error_model="numpy", cache=True)
def _jacobians_into(k: Floats, points: Floats, by_point: Floats, by_intrinsics: Floats) -> None:
    by_point[:] = 0.0
    by_intrinsics[:] = 0.0
    for i in range(points.shape[0]):
        _jacobian_into(k, points[i, 0], points[i, 1], points[i, 2], by_point[i], by_intrinsics[i])


@njit(nogil=True, error_model="numpy", fastmath=False)
def _jacobian_into(k: Floats, x: float, y: float, z: float, P: Floats, J: Floats) -> None:
    f_x, f_y, k1, k2, k3, k4 = k[0], k[1], k[4], k[5], k[6], k[7]
    # On the axis the direction (x, y) / r is undefined and its factor zero: any tiny radius gives the limit.
    r = max(sqrt(x * x + y * y), 1e-9)
    theta = max(polar_angle(r, z), 1e-18)
    t2 = theta * theta
    theta_d = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
    square = r * r + z * z
    scale = theta_d / r
    scale_r = (slope * z / square - scale) / r
    x_r, y_r = x / r, y / r
    P[0, 0] = f_x * (scale + x * scale_r * x_r)
    P[0, 1] = f_x * x * scale_r * y_r
    P[0, 2] = -f_x * x * slope / square
    P[1, 0] = f_y * y * scale_r * x_r
    P[1, 1] = f_y * (scale + y * scale_r * y_r)
    P[1, 2] = -f_y * y * slope / square
    J[0, 0] = x * scale
    J[1, 1] = y * scale
    J[0, 2] = 1.0
    J[1, 3] = 1.0
    power = theta
    for column in range(4, 8):
        power *= t2
        J[0, column] = f_x * x_r * power
        J[1, column] = f_y * y_r * power


@njit(nogil=True, error_model="numpy", cache=True)
def _rays_into(k: Floats, marks: Floats, rays: Floats) -> None:
    # A hair inside the fold, where the projection is still one.
    fold = kannala_brandt_fold(k[4], k[5], k[6], k[7]) * (1.0 - 1e-12)
    for i in range(marks.shape[0]):
        y = (marks[i, 1] - k[3]) / k[1]
        x = (marks[i, 0] - k[2]) / k[0]
        r = hypot(x, y)
        theta = grown_radius(r, fold, k[4], k[5], k[6], k[7])
        across = sin(theta) / r if r > 0.0 else 0.0
        rays[i, 0], rays[i, 1], rays[i, 2] = x * across, y * across, cos(theta)


def _fold_angle(k: Floats) -> float:
    return float(kannala_brandt_fold(k[4], k[5], k[6], k[7]))


@njit(nogil=True, error_model="numpy", fastmath=VECTOR, cache=True)
def _total_distance(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    r, s, z = mount_rows(p, form)
    f_x, f_y, c_x, c_y = np.float32(p[6]), np.float32(p[7]), np.float32(p[8]), np.float32(p[9])
    k1, k2, k3, k4 = np.float32(p[10]), np.float32(p[11]), np.float32(p[12]), np.float32(p[13])
    fold = np.float32(kannala_brandt_fold(p[10], p[11], p[12], p[13]))
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = ZERO
    for i in range(pack.shape[1]):
        u, v, violation = kannala_brandt_point(
            r[0] * X[i] + r[1] * Y[i] + r[2] * Z[i] + r[3],
            s[0] * X[i] + s[1] * Y[i] + s[2] * Z[i] + s[3],
            z[0] * X[i] + z[1] * Y[i] + z[2] * Z[i] + z[3],
            f_x, f_y, c_x, c_y, k1, k2, k3, k4, fold,
        )  # fmt: skip
        total += W[i] * distance_of(u, v, violation, U[i], V[i], diagonal, bend)
    return total


@njit(nogil=True, error_model="numpy", cache=True)
def _total_distances_into(
    box: Box, targets: Targets, population: Singles, totals: Singles, first: int, stop: Flag
) -> None:
    form, pack, diagonal, bend = targets
    base, free, lower, width = box
    p = base.copy()
    for n in range(first, population.shape[1]):
        # The totals that are stored in between keep the compiler from reading the flag only once.
        if stop[0] != 0:
            return
        place_individual(free, lower, width, population, n, p)
        totals[n] = _total_distance(p, form, pack, diagonal, bend)


KANNALA_BRANDT: Final = Projection(
    project_into=_project_into,
    jacobians_into=_jacobians_into,
    rays_into=_rays_into,
    fold_angle=_fold_angle,
    total_distances_into=_total_distances_into,
    linear_start=radial_alignment_start(inlier_share=0.02),
)
