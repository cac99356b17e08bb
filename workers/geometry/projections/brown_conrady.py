"""The paper's eq. 4 in its standard form: radial and tangential polynomials of x / z and y / z, with a skew.

Heikkila and Silven 1997; Bouguet; cv2.projectPoints, plus skew. (k1 k2 k3 k4 k5) are OpenCV's (k1 k2 p1 p2 k3).
"""

from typing import Final

import numpy as np
from numba import njit

from workers.geometry.fold_radius import first_zero
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


# Exact arithmetic is requested explicitly: numba lets a callee inherit its caller's fast-math flags, so that its bits
# would depend on which caller was compiled first.
@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def brown_conrady_fold(k1: float, k2: float, k5: float) -> float:
    """r^2 at which the radial distortion r d(r^2) stops growing, infinity where it never does."""
    # r^2 = x / (1 - x) maps all radii onto (0, 1); times (1 - x)^3 the derivative is this cubic.
    a, b, c = 3.0 * k1, 5.0 * k2, 7.0 * k5
    if a >= 0.0 and b >= 0.0 and c >= 0.0:
        return np.inf  # every term grows; the cubic below may have a threefold zero at 1, which rounding moves
    x = first_zero(a - 3.0, 3.0 - 2.0 * a + b, a - b + c - 1.0, 0.0)
    if x >= 1.0:
        return np.inf
    s = x / (1.0 - x)
    # The map costs digits far out: one step of Newton in r^2 itself.
    slope = a + s * (2.0 * b + s * 3.0 * c)
    step = (1.0 + s * (a + s * (b + s * c))) / slope
    return s - step if abs(step) < 1e-6 * s else s


@njit(nogil=True, error_model="numpy", fastmath=FUSED, forceinline=True)
def brown_conrady_point(
    x: Scalar,
    y: Scalar,
    z: Scalar,
    f_x: Scalar,
    f_y: Scalar,
    c_x: Scalar,
    c_y: Scalar,
    skew: Scalar,
    k1: Scalar,
    k2: Scalar,
    k3: Scalar,
    k4: Scalar,
    k5: Scalar,
    fold_r2: Scalar,
) -> Projected:
    """One point's pixel and violation; `fold_r2` comes from `brown_conrady_fold`, once per set of parameters."""
    one = type(z)(1.0)
    nearest = type(z)(NEAREST_DEPTH_M)
    behind = nearest - z
    # One division serves both: the pixel before the camera, the violation behind it.
    inverse = one / (one + behind if behind > 0 else z)
    scale = type(z)(FARTHEST_SCALE) if behind > 0 else inverse
    a = x * scale
    b = y * scale
    aa = a * a
    bb = b * b
    ab = a * b
    r2 = aa + bb
    grow = r2 * (k1 + r2 * (k2 + r2 * k5))
    a_d = a + a * grow + k3 * (ab + ab) + k4 * (r2 + aa + aa)
    b_d = b + b * grow + k3 * (r2 + bb + bb) + k4 * (ab + ab)
    past = r2 - fold_r2
    violation = past / (one + r2) if past > 0 else type(z)(0.0)
    violation = one + behind * inverse if behind > 0 else violation
    return f_x * (a_d + skew * b_d) + c_x, f_y * b_d + c_y, violation


@njit(nogil=True, error_model="numpy", cache=True)
def _project_into(k: Floats, points: Floats, pixels: Floats, violation: Floats) -> None:
    fold_r2 = brown_conrady_fold(k[5], k[6], k[9])
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1], violation[i] = brown_conrady_point(
            points[i, 0], points[i, 1], points[i, 2],
            k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], fold_r2,
        )  # fmt: skip


def _fold_radius(k: Floats) -> float:
    return float(np.sqrt(brown_conrady_fold(k[5], k[6], k[9])))


def _fold_angle(k: Floats) -> float:
    return float(np.arctan(_fold_radius(k)))


@njit(nogil=True, error_model="numpy", fastmath=VECTOR, cache=True)
def _total_distance(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    r, s, z = mount_rows(p, form)
    f_x, f_y, c_x, c_y = np.float32(p[6]), np.float32(p[7]), np.float32(p[8]), np.float32(p[9])
    skew, k1, k2, k3 = np.float32(p[10]), np.float32(p[11]), np.float32(p[12]), np.float32(p[13])
    k4, k5 = np.float32(p[14]), np.float32(p[15])
    fold = np.float32(brown_conrady_fold(p[11], p[12], p[15]))
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = ZERO
    for i in range(pack.shape[1]):
        u, v, violation = brown_conrady_point(
            r[0] * X[i] + r[1] * Y[i] + r[2] * Z[i] + r[3],
            s[0] * X[i] + s[1] * Y[i] + s[2] * Z[i] + s[3],
            z[0] * X[i] + z[1] * Y[i] + z[2] * Z[i] + z[3],
            f_x, f_y, c_x, c_y, skew, k1, k2, k3, k4, k5, fold,
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


BROWN_CONRADY: Final = Projection(
    project_into=_project_into,
    jacobians_into=jacobians_of(range(10)),
    rays_into=rays_of(range(10), _fold_radius),
    fold_angle=_fold_angle,
    total_distances_into=_total_distances_into,
    linear_start=direct_linear_start(inlier_share=0.02),
)
