"""One compiled scalar projection per camera model; every room of the house projects through these.

All take the point in the camera frame (optical axes: x right, y down, z forward, metres) and give
(u, v, violation): pixels, (0, 0) the centre of the top-left pixel, and 0 for a good projection or else a positive
number that grows with how far the point is from being one (behind the camera, or past the radius where the
distortion stops growing). They work in the precision of their arguments, so that the genetic algorithm runs them
in single and everything else in double.
"""

from math import atan2, sqrt
from typing import Any, Final

import numpy as np
from numba import njit, types
from numba.extending import overload

Scalar = float | np.floating[Any]
Projected = tuple[Scalar, Scalar, Scalar]

NEAREST_DEPTH_M: Final = 1e-3
"""Points less than this in front of a perspective camera's plane count as behind it."""
_FARTHEST_SCALE: Final = 1.0 / NEAREST_DEPTH_M

# Fused multiply-add is allowed; nothing that assumes finite numbers is.
_FUSED: Final = {"contract", "nsz", "arcp"}

# atan on [0, 1] in single precision, odd minimax polynomial (the coefficients of SLEEF's atanf, error 2e-7 rad).
_ATAN = tuple(
    np.float32(value)
    for value in (
        0.00282363896258175373077393,
        -0.0159569028764963150024414,
        0.0425049886107444763183594,
        -0.0748900920152664184570312,
        0.106347933411598205566406,
        -0.142027363181114196777344,
        0.199926957488059997558594,
        -0.333331018686294555664062,
    )
)
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7 = _ATAN
_PI32: Final = np.float32(np.pi)
_HALF_PI32: Final = np.float32(np.pi / 2)
_TINY32: Final = np.float32(1e-30)


def polar_angle(r: Scalar, z: Scalar) -> float:
    """Angle from the optical axis in [0, pi] of a point r >= 0 beside and z along it."""
    return atan2(r, z)


def _polar_angle_single(r: Any, z: Any) -> Any:
    # Without SVML atan2 is a scalar call that keeps the loop from being vectorised; this polynomial is not.
    depth = abs(z)
    low = min(r, depth)
    high = max(max(r, depth), _TINY32)
    q = low / high
    s = q * q
    p = _A0
    p = p * s + _A1
    p = p * s + _A2
    p = p * s + _A3
    p = p * s + _A4
    p = p * s + _A5
    p = p * s + _A6
    p = p * s + _A7
    angle = q + q * s * p
    angle = _HALF_PI32 - angle if r > depth else angle
    return _PI32 - angle if z < depth else angle


def _polar_angle_double(r: Any, z: Any) -> Any:
    return atan2(r, z)


@overload(polar_angle, jit_options={"error_model": "numpy"})
def _polar_angle_overload(r: Any, z: Any) -> Any:
    return _polar_angle_single if r is types.float32 else _polar_angle_double


@njit(nogil=True, error_model="numpy", fastmath=_FUSED, forceinline=True)
def pinhole_point(x: Scalar, y: Scalar, z: Scalar, f_x: Scalar, f_y: Scalar, c_x: Scalar, c_y: Scalar) -> Projected:
    """u = f_x x / z + c_x, v = f_y y / z + c_y (the paper's eq. 3; cv2.projectPoints without distortion)."""
    one = type(z)(1.0)
    nearest = type(z)(NEAREST_DEPTH_M)
    behind = nearest - z
    # One division serves both: the pixel before the camera, the violation behind it.
    inverse = one / (one + behind if behind > 0 else z)
    scale = type(z)(_FARTHEST_SCALE) if behind > 0 else inverse
    violation = one + behind * inverse if behind > 0 else type(z)(0.0)
    return f_x * (x * scale) + c_x, f_y * (y * scale) + c_y, violation


@njit(nogil=True, error_model="numpy", fastmath=_FUSED, forceinline=True)
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
    """The paper's eq. 4 in its standard form (Heikkila and Silven 1997; Bouguet; cv2.projectPoints, plus skew).

    `fold_r2` comes from `fold_radius.brown_conrady_fold`, once per set of parameters.
    """
    one = type(z)(1.0)
    nearest = type(z)(NEAREST_DEPTH_M)
    behind = nearest - z
    # One division serves both: the pixel before the camera, the violation behind it.
    inverse = one / (one + behind if behind > 0 else z)
    scale = type(z)(_FARTHEST_SCALE) if behind > 0 else inverse
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


@njit(nogil=True, error_model="numpy", fastmath=_FUSED, forceinline=True)
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
    """theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) (cv2.fisheye.projectPoints).

    Sees beyond 90 degrees, up to `fold_theta` (from `fold_radius.kannala_brandt_fold`, at most pi).
    """
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
