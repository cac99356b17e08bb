"""Analytic derivatives of the projections, in double precision, for least squares and its covariance."""

from collections.abc import Mapping
from math import sqrt

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from workers.geometry.camera_kernels import NEAREST_DEPTH_M, polar_angle
from workers.geometry.models import MODEL_ID, ModelName
from workers.geometry.projection import intrinsics_vector, points_array, project_into

Floats = NDArray[np.float64]


def project_with_jacobian(
    model: ModelName, intrinsics: Mapping[str, float] | ArrayLike, points_camera: ArrayLike
) -> tuple[Floats, Floats, Floats, Floats]:
    """As `projection.project`, with derivatives.

    Returns pixels (N, 2), violation (N,), d pixels / d point (N, 2, 3) in px per metre, and d pixels / d intrinsics
    (N, 2, n) in INTRINSICS order. Where the projection is forbidden the derivatives are zero.
    """
    values = intrinsics_vector(model, intrinsics)
    points = points_array(points_camera)
    n = len(points)
    pixels, violation = np.empty((n, 2)), np.empty(n)
    by_point, by_intrinsics = np.empty((n, 2, 3)), np.empty((n, 2, len(values)))
    project_into(MODEL_ID[model], values, points, pixels, violation)
    jacobians_into(MODEL_ID[model], values, points, by_point, by_intrinsics)
    bad = violation > 0.0
    pixels[bad] = np.nan
    by_point[bad] = 0.0
    by_intrinsics[bad] = 0.0
    return pixels, violation, by_point, by_intrinsics


@njit(nogil=True, error_model="numpy", cache=True)
def jacobians_into(model_id: int, k: Floats, points: Floats, by_point: Floats, by_intrinsics: Floats) -> None:
    """Fill by_point (N, 2, 3) and by_intrinsics (N, 2, n) of points (N, 3) in the camera frame."""
    by_point[:] = 0.0
    by_intrinsics[:] = 0.0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if model_id == 2:
            _kannala_brandt(k, x, y, z, by_point[i], by_intrinsics[i])
        else:
            depth = max(z, NEAREST_DEPTH_M)
            _perspective(model_id, k, x / depth, y / depth, 1.0 / depth, by_point[i], by_intrinsics[i])


@njit(nogil=True, error_model="numpy")
def _perspective(model_id: int, k: Floats, a: float, b: float, inverse_z: float, P: Floats, J: Floats) -> None:
    f_x, f_y = k[0], k[1]
    a_d, b_d, skew = a, b, 0.0
    aa, ab, bb = 1.0, 0.0, 1.0  # d a_d / d a, d a_d / d b = d b_d / d a, d b_d / d b
    if model_id == 1:
        skew, k1, k2, k3, k4, k5 = k[4], k[5], k[6], k[7], k[8], k[9]
        r2 = a * a + b * b
        d = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k5))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k5))
        a_d = a * d + 2.0 * k3 * a * b + k4 * (r2 + 2.0 * a * a)
        b_d = b * d + k3 * (r2 + 2.0 * b * b) + 2.0 * k4 * a * b
        aa = d + a * a * slope + 2.0 * k3 * b + 6.0 * k4 * a
        ab = a * b * slope + 2.0 * k3 * a + 2.0 * k4 * b
        bb = d + b * b * slope + 6.0 * k3 * b + 2.0 * k4 * a
        power = 1.0
        for column in (5, 6, 9):
            power *= r2
            J[0, column] = f_x * (a + skew * b) * power
            J[1, column] = f_y * b * power
        J[0, 4] = f_x * b_d
        J[0, 7] = f_x * (2.0 * a * b + skew * (r2 + 2.0 * b * b))
        J[1, 7] = f_y * (r2 + 2.0 * b * b)
        J[0, 8] = f_x * (r2 + 2.0 * a * a + skew * 2.0 * a * b)
        J[1, 8] = f_y * 2.0 * a * b
    J[0, 0] = a_d + skew * b_d
    J[1, 1] = b_d
    J[0, 2] = 1.0
    J[1, 3] = 1.0
    u_a, u_b = f_x * (aa + skew * ab), f_x * (ab + skew * bb)
    v_a, v_b = f_y * ab, f_y * bb
    P[0, 0], P[0, 1], P[0, 2] = u_a * inverse_z, u_b * inverse_z, -(u_a * a + u_b * b) * inverse_z
    P[1, 0], P[1, 1], P[1, 2] = v_a * inverse_z, v_b * inverse_z, -(v_a * a + v_b * b) * inverse_z


@njit(nogil=True, error_model="numpy")
def _kannala_brandt(k: Floats, x: float, y: float, z: float, P: Floats, J: Floats) -> None:
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
