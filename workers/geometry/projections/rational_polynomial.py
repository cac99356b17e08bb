"""A quotient of two radial polynomials and tangential terms: OpenCV's eight coefficients, for wide lenses.

cv2.projectPoints with k1 k2 p1 p2 k3 k4 k5 k6; ``rational_polynomial`` of sensor_msgs/CameraInfo.
"""

from typing import Final

import numpy as np
from numba import njit

from workers.geometry.fold_radius import first_zero_of
from workers.geometry.linear_cameras import direct_linear_start
from workers.geometry.projections.perspective import FARTHEST_SCALE, NEAREST_DEPTH_M, jacobians_of, rays_of
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
def rational_polynomial_fold(k1: float, k2: float, k3: float, k4: float, k5: float, k6: float) -> float:
    """r^2 at which the radial distortion stops growing or its divisor is no longer positive; infinity if never."""
    # With s = r^2, N / M the factor: of r N / M the derivative is (N M + 2 s (N' M - N M')) / M^2. s = x / (1 - x)
    # maps all radii onto (0, 1); times (1 - x)^6 that numerator has these Bernstein coefficients.
    if k1 >= 0.0 and k2 >= 0.0 and k3 >= 0.0 and k4 == 0.0 and k5 == 0.0 and k6 == 0.0:
        return np.inf  # every term grows
    n, m = (1.0, k1, k2, k3), (1.0, k4, k5, k6)
    growth = np.zeros(7)
    for i in range(4):
        for j in range(4):
            growth[i + j] += (1.0 + 2.0 * (i - j)) * n[i] * m[j]
    for order, ways in enumerate((1.0, 6.0, 15.0, 20.0, 15.0, 6.0, 1.0)):
        growth[order] /= ways
    divisor = np.array([1.0, k4 / 3.0, k5 / 3.0, k6])
    x = min(first_zero_of(growth), first_zero_of(divisor))
    return x / (1.0 - x) if x < 1.0 else np.inf


@njit(nogil=True, error_model="numpy", fastmath=FUSED, forceinline=True)
def rational_polynomial_point(
    x: Scalar,
    y: Scalar,
    z: Scalar,
    f_x: Scalar,
    f_y: Scalar,
    c_x: Scalar,
    c_y: Scalar,
    k1: Scalar,
    k2: Scalar,
    p1: Scalar,
    p2: Scalar,
    k3: Scalar,
    k4: Scalar,
    k5: Scalar,
    k6: Scalar,
    fold_r2: Scalar,
) -> Projected:
    """One point's pixel and violation; `fold_r2` comes from `rational_polynomial_fold`."""
    one = type(z)(1.0)
    nearest = type(z)(NEAREST_DEPTH_M)
    behind = nearest - z
    inverse = one / (one + behind if behind > 0 else z)
    scale = type(z)(FARTHEST_SCALE) if behind > 0 else inverse
    a = x * scale
    b = y * scale
    aa = a * a
    bb = b * b
    ab = a * b
    r2 = aa + bb
    d = (one + r2 * (k1 + r2 * (k2 + r2 * k3))) / (one + r2 * (k4 + r2 * (k5 + r2 * k6)))
    a_d = a * d + p1 * (ab + ab) + p2 * (r2 + aa + aa)
    b_d = b * d + p1 * (r2 + bb + bb) + p2 * (ab + ab)
    past = r2 - fold_r2
    violation = past / (one + r2) if past > 0 else type(z)(0.0)
    violation = one + behind * inverse if behind > 0 else violation
    return f_x * a_d + c_x, f_y * b_d + c_y, violation


@njit(nogil=True, error_model="numpy", cache=True)
def _project_into(k: Floats, points: Floats, pixels: Floats, violation: Floats) -> None:
    fold_r2 = rational_polynomial_fold(k[4], k[5], k[8], k[9], k[10], k[11])
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1], violation[i] = rational_polynomial_point(
            points[i, 0], points[i, 1], points[i, 2],
            k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], k[10], k[11], fold_r2,
        )  # fmt: skip


def _fold_radius(k: Floats) -> float:
    return float(np.sqrt(rational_polynomial_fold(k[4], k[5], k[8], k[9], k[10], k[11])))


def _fold_angle(k: Floats) -> float:
    return float(np.arctan(_fold_radius(k)))


@njit(nogil=True, error_model="numpy", fastmath=VECTOR, cache=True)
def _total_distance(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    r, s, z = mount_rows(p, form)
    f_x, f_y, c_x, c_y = np.float32(p[6]), np.float32(p[7]), np.float32(p[8]), np.float32(p[9])
    k1, k2, p1, p2 = np.float32(p[10]), np.float32(p[11]), np.float32(p[12]), np.float32(p[13])
    k3, k4, k5, k6 = np.float32(p[14]), np.float32(p[15]), np.float32(p[16]), np.float32(p[17])
    fold = np.float32(rational_polynomial_fold(p[10], p[11], p[14], p[15], p[16], p[17]))
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = ZERO
    for i in range(pack.shape[1]):
        u, v, violation = rational_polynomial_point(
            r[0] * X[i] + r[1] * Y[i] + r[2] * Z[i] + r[3],
            s[0] * X[i] + s[1] * Y[i] + s[2] * Z[i] + s[3],
            z[0] * X[i] + z[1] * Y[i] + z[2] * Z[i] + z[3],
            f_x, f_y, c_x, c_y, k1, k2, p1, p2, k3, k4, k5, k6, fold,
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


_COLUMNS: Final = (0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11, 12)

RATIONAL_POLYNOMIAL: Final = Projection(
    project_into=_project_into,
    jacobians_into=jacobians_of(_COLUMNS),
    rays_into=rays_of(_COLUMNS, _fold_radius),
    fold_angle=_fold_angle,
    total_distances_into=_total_distances_into,
    linear_start=direct_linear_start(inlier_share=0.02),
)
