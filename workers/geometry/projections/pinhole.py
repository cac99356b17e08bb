"""The pinhole camera: u = f_x x / z + c_x, v = f_y y / z + c_y (the paper's eq. 3)."""

from math import pi, sqrt
from typing import Final

import numpy as np
from numba import njit

from workers.geometry.linear_cameras import direct_linear_start
from workers.geometry.projections.perspective import FARTHEST_SCALE, NEAREST_DEPTH_M, jacobians_of
from workers.geometry.projections.record import FUSED, Floats, Projected, Projection, Scalar
from workers.geometry.projections.single_precision import (
    ONE,
    VECTOR,
    ZERO,
    Box,
    Flag,
    Singles,
    Targets,
    distance_of,
    place_individual,
)
from workers.geometry.rotations import rotation_rows


@njit(nogil=True, error_model="numpy", fastmath=FUSED, forceinline=True)
def pinhole_point(x: Scalar, y: Scalar, z: Scalar, f_x: Scalar, f_y: Scalar, c_x: Scalar, c_y: Scalar) -> Projected:
    """One point's pixel and violation (cv2.projectPoints without distortion)."""
    one = type(z)(1.0)
    nearest = type(z)(NEAREST_DEPTH_M)
    behind = nearest - z
    # One division serves both: the pixel before the camera, the violation behind it.
    inverse = one / (one + behind if behind > 0 else z)
    scale = type(z)(FARTHEST_SCALE) if behind > 0 else inverse
    violation = one + behind * inverse if behind > 0 else type(z)(0.0)
    return f_x * (x * scale) + c_x, f_y * (y * scale) + c_y, violation


@njit(nogil=True, error_model="numpy", cache=True)
def _project_into(k: Floats, points: Floats, pixels: Floats, violation: Floats) -> None:
    for i in range(points.shape[0]):
        pixels[i, 0], pixels[i, 1], violation[i] = pinhole_point(
            points[i, 0], points[i, 1], points[i, 2], k[0], k[1], k[2], k[3]
        )


@njit(nogil=True, error_model="numpy", cache=True)
def _rays_into(k: Floats, marks: Floats, rays: Floats) -> None:
    for i in range(marks.shape[0]):
        y = (marks[i, 1] - k[3]) / k[1]
        x = (marks[i, 0] - k[2]) / k[0]
        norm = sqrt(1.0 + x * x + y * y)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / norm, y / norm, 1.0 / norm


def _fold_angle(k: Floats) -> float:
    return 0.5 * pi


@njit(nogil=True, error_model="numpy", fastmath=VECTOR, cache=True)
def _total_distance(p: Floats, form: int, pack: Singles, diagonal: np.float32, bend: np.float32) -> np.float32:
    R = rotation_rows(form, p[0], p[1], p[2])
    f_x, f_y, c_x, c_y = p[6], p[7], p[8], p[9]
    # The intrinsics go into the rows of K [R | t], so that a pair costs nine products and a division.
    a0, a1, a2 = (
        np.float32(f_x * R[0] + c_x * R[6]),
        np.float32(f_x * R[1] + c_x * R[7]),
        np.float32(f_x * R[2] + c_x * R[8]),
    )
    b0, b1, b2 = (
        np.float32(f_y * R[3] + c_y * R[6]),
        np.float32(f_y * R[4] + c_y * R[7]),
        np.float32(f_y * R[5] + c_y * R[8]),
    )
    z0, z1, z2 = np.float32(R[6]), np.float32(R[7]), np.float32(R[8])
    a3, b3, z3 = np.float32(f_x * p[3] + c_x * p[5]), np.float32(f_y * p[4] + c_y * p[5]), np.float32(p[5])
    X, Y, Z, U, V, W = pack[0], pack[1], pack[2], pack[3], pack[4], pack[5]
    total = ZERO
    for i in range(pack.shape[1]):
        u, v, violation = pinhole_point(
            a0 * X[i] + a1 * Y[i] + a2 * Z[i] + a3,
            b0 * X[i] + b1 * Y[i] + b2 * Z[i] + b3,
            z0 * X[i] + z1 * Y[i] + z2 * Z[i] + z3,
            ONE, ONE, ZERO, ZERO,
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


PINHOLE: Final = Projection(
    project_into=_project_into,
    jacobians_into=jacobians_of(range(4)),
    rays_into=_rays_into,
    fold_angle=_fold_angle,
    total_distances_into=_total_distances_into,
    linear_start=direct_linear_start(inlier_share=0.01),
)
