"""The common part of models that divide by the depth: derivatives and rays of a radial quotient and tangential terms.

``lens`` (13,) is f_x f_y c_x c_y skew k1 k2 p1 p2 k3 k4 k5 k6 in OpenCV's sense: with a = x / z, b = y / z, s = a^2 +
b^2 the radial factor is (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3).
"""

from collections.abc import Callable, Sequence
from math import hypot, isfinite, sqrt
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
NEAREST_DEPTH_M: Final = 1e-3
"""Points less than this in front of the camera's plane count as behind it."""
FARTHEST_SCALE: Final = 1.0 / NEAREST_DEPTH_M
_LENS: Final = 13


def jacobians_of(columns: Sequence[int]) -> Callable[[Floats, Floats, Floats, Floats], None]:
    """``jacobians_into`` of the model whose intrinsics are these entries of ``lens``."""
    chosen = np.array(columns, np.int64)

    def jacobians_into(k: Floats, points: Floats, by_point: Floats, by_intrinsics: Floats) -> None:
        _jacobians_into(_whole(k, chosen), chosen, points, by_point, by_intrinsics)

    return jacobians_into


def rays_of(
    columns: Sequence[int], fold_radius: Callable[[Floats], float]
) -> Callable[[Floats, Floats, Floats], None]:
    """``rays_into`` of the model whose intrinsics are these entries of ``lens``, up to its ``fold_radius`` (k)."""
    chosen = np.array(columns, np.int64)

    def rays_into(k: Floats, marks: Floats, rays: Floats) -> None:
        # A hair inside the fold, where the projection is still one.
        _rays_into(_whole(k, chosen), fold_radius(k) * (1.0 - 1e-12), marks, rays)

    return rays_into


def _whole(k: Floats, columns: NDArray[np.int64]) -> Floats:
    lens = np.zeros(_LENS)
    lens[columns] = k
    return lens


@njit(nogil=True, error_model="numpy", fastmath=False)
def _bent(lens: Floats, a: float, b: float) -> tuple[float, float, float, float, float, float, float]:
    """(a_d, b_d), their slopes d a_d / d a, d a_d / d b = d b_d / d a and d b_d / d b, the factor and its divisor."""
    p1, p2 = lens[7], lens[8]
    s = a * a + b * b
    below = 1.0 + s * (lens[10] + s * (lens[11] + s * lens[12]))
    d = (1.0 + s * (lens[5] + s * (lens[6] + s * lens[9]))) / below
    slope = (lens[5] + s * (2.0 * lens[6] + s * 3.0 * lens[9])) - d * (
        lens[10] + s * (2.0 * lens[11] + s * 3.0 * lens[12])
    )
    slope = 2.0 * slope / below
    a_d = a * d + 2.0 * p1 * a * b + p2 * (s + 2.0 * a * a)
    b_d = b * d + p1 * (s + 2.0 * b * b) + 2.0 * p2 * a * b
    aa = d + a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a
    ab = a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b
    bb = d + b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a
    return a_d, b_d, aa, ab, bb, d, below


@njit(nogil=True, error_model="numpy", cache=True)
def _jacobians_into(
    lens: Floats, columns: NDArray[np.int64], points: Floats, by_point: Floats, by_intrinsics: Floats
) -> None:
    f_x, f_y, skew = lens[0], lens[1], lens[4]
    J = np.zeros((2, _LENS))
    for i in range(points.shape[0]):
        depth = max(points[i, 2], NEAREST_DEPTH_M)
        a, b = points[i, 0] / depth, points[i, 1] / depth
        s = a * a + b * b
        a_d, b_d, aa, ab, bb, d, below = _bent(lens, a, b)
        power = 1.0 / below
        for above, under in ((5, 10), (6, 11), (9, 12)):
            power *= s
            J[0, above] = f_x * (a + skew * b) * power
            J[1, above] = f_y * b * power
            J[0, under] = -d * J[0, above]
            J[1, under] = -d * J[1, above]
        J[0, 4] = f_x * b_d
        J[0, 7] = f_x * (2.0 * a * b + skew * (s + 2.0 * b * b))
        J[1, 7] = f_y * (s + 2.0 * b * b)
        J[0, 8] = f_x * (s + 2.0 * a * a + skew * 2.0 * a * b)
        J[1, 8] = f_y * 2.0 * a * b
        J[0, 0], J[0, 1], J[0, 2], J[0, 3] = a_d + skew * b_d, 0.0, 1.0, 0.0
        J[1, 0], J[1, 1], J[1, 2], J[1, 3] = 0.0, b_d, 0.0, 1.0
        u_a, u_b = f_x * (aa + skew * ab), f_x * (ab + skew * bb)
        v_a, v_b = f_y * ab, f_y * bb
        P, inverse = by_point[i], 1.0 / depth
        P[0, 0], P[0, 1], P[0, 2] = u_a * inverse, u_b * inverse, -(u_a * a + u_b * b) * inverse
        P[1, 0], P[1, 1], P[1, 2] = v_a * inverse, v_b * inverse, -(v_a * a + v_b * b) * inverse
        for n in range(columns.shape[0]):
            by_intrinsics[i, 0, n] = J[0, columns[n]]
            by_intrinsics[i, 1, n] = J[1, columns[n]]


@njit(nogil=True, error_model="numpy", cache=True)
def _rays_into(lens: Floats, fold: float, marks: Floats, rays: Floats) -> None:
    for i in range(marks.shape[0]):
        y = (marks[i, 1] - lens[3]) / lens[1]
        x = (marks[i, 0] - lens[2]) / lens[0]
        x, y = _undistorted(lens, x - lens[4] * y, y, fold)
        norm = sqrt(1.0 + x * x + y * y)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / norm, y / norm, 1.0 / norm


@njit(nogil=True, error_model="numpy")
def _undistorted(lens: Floats, x: float, y: float, fold: float) -> tuple[float, float]:
    # The radial part alone gives a start; near the fold, where the tangential part bends most, nearer ones help.
    target = hypot(x, y)
    if target == 0.0:
        return _newton(lens, x, y, fold, 0.0, 0.0)[:2]
    r = _radius(lens, target, fold) / target
    best_a, best_b, error = _newton(lens, x, y, fold, x * r, y * r)
    for share in (0.8, 0.6, 0.4):
        if error <= 1e-12 * (1.0 + target):
            break
        a, b, now = _newton(lens, x, y, fold, x * r * share, y * r * share)
        if now < error:
            best_a, best_b, error = a, b, now
    return best_a, best_b


@njit(nogil=True, error_model="numpy")
def _radius(lens: Floats, target: float, fold: float) -> float:
    # The r in [0, fold] whose radial distortion, which grows there, is `target`; the fold where none is.
    low, high = 0.0, fold if isfinite(fold) else max(target, 1.0)
    while not isfinite(fold) and high < 1e8 and high * _factor(lens, high * high) < target:
        high *= 2.0
    for _ in range(200):
        r = 0.5 * (low + high)
        low, high = (r, high) if r * _factor(lens, r * r) < target else (low, r)
        if high - low <= 1e-6 * high:  # Newton's method has the rest
            break
    return high


@njit(nogil=True, error_model="numpy")
def _factor(lens: Floats, s: float) -> float:
    above = 1.0 + s * (lens[5] + s * (lens[6] + s * lens[9]))
    return above / (1.0 + s * (lens[10] + s * (lens[11] + s * lens[12])))


@njit(nogil=True, error_model="numpy")
def _newton(lens: Floats, x: float, y: float, fold: float, a: float, b: float) -> tuple[float, float, float]:
    # Newton on the two equations of the distortion: (a, b) that distort to (x, y), and what is left of the error.
    error, best_a, best_b = np.inf, a, b
    for _ in range(60):
        a_d, b_d, aa, ab, bb, _d, _below = _bent(lens, a, b)
        ea, eb = a_d - x, b_d - y
        now = hypot(ea, eb)
        if now >= error:
            # No nearer: half way back to where it was, until that is rounding.
            a, b = 0.5 * (a + best_a), 0.5 * (b + best_b)
            if hypot(a - best_a, b - best_b) <= 1e-16 * (1.0 + hypot(a, b)):
                break
            continue
        error, best_a, best_b = now, a, b
        det = aa * bb - ab * ab
        if error == 0.0 or det == 0.0:
            break
        a -= (bb * ea - ab * eb) / det
        b -= (aa * eb - ab * ea) / det
        # Never past the fold, where the formula goes on and means nothing.
        r = hypot(a, b)
        if r > fold:
            a, b = a * fold / r, b * fold / r
    return best_a, best_b, error
