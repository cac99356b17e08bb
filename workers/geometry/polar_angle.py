"""The angle of a point from the optical axis, in both precisions."""

from math import atan2
from typing import Any, Final

import numpy as np
from numba import types
from numba.extending import overload

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


def polar_angle(r: float | np.floating[Any], z: float | np.floating[Any]) -> float:
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
