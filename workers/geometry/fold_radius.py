"""The radius at which a lens polynomial stops growing: exact for all coefficients, and cheap enough for the hot loop.

The first zero of a derivative 1 + p1 x + ... + p4 x^4 on (0, 1] is isolated by its Bernstein coefficients: where all
are positive there is none, and where they change sign once there is exactly one (Farouki and Rajan 1987; Descartes).
Other pieces are halved. So a fold and its undoing close behind are seen, unlike on any grid.
"""

from math import isfinite
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NONE: Final = 2.0
_SHORTEST: Final = 1e-12


# Exact arithmetic is requested explicitly: numba lets a callee inherit its caller's fast-math flags, so that its bits
# would depend on which caller was compiled first.
@njit(nogil=True, error_model="numpy", fastmath=False)
def first_zero(p1: float, p2: float, p3: float, p4: float) -> float:
    """The least x in (0, 1] at which g(x) = 1 + p1 x + p2 x^2 + p3 x^3 + p4 x^4 is no longer positive; 2 if none."""
    # Bernstein coefficients of g on what is left, (start, 1].
    b0 = 1.0
    b1 = 1.0 + 0.25 * p1
    b2 = 1.0 + 0.5 * p1 + p2 / 6.0
    b3 = 1.0 + 0.75 * p1 + 0.5 * p2 + 0.25 * p3
    b4 = 1.0 + p1 + p2 + p3 + p4
    if b1 > 0.0 and b2 > 0.0 and b3 > 0.0 and b4 > 0.0:
        return _NONE
    if _one_change(b1, b2, b3, b4):
        return _zero_between(p1, p2, p3, p4, 0.0, 1.0)
    start, share = 0.0, 0.5
    while True:
        left, rest = 1.0 - share, share
        # De Casteljau: the diagonals are the coefficients of the first `share` of what is left, and of its rest.
        c01, c12 = left * b0 + rest * b1, left * b1 + rest * b2
        c23, c34 = left * b2 + rest * b3, left * b3 + rest * b4
        c02, c13, c24 = left * c01 + rest * c12, left * c12 + rest * c23, left * c23 + rest * c34
        c03, c14 = left * c02 + rest * c13, left * c13 + rest * c24
        c04 = left * c03 + rest * c14
        if c01 > 0.0 and c02 > 0.0 and c03 > 0.0 and c04 > 0.0:
            if share == 1.0:
                return _NONE
            start += share * (1.0 - start)
            b0, b1, b2, b3 = c04, c14, c24, c34
            share = 1.0
            continue
        width = share * (1.0 - start)
        if _one_change(c01, c02, c03, c04):
            return _zero_between(p1, p2, p3, p4, start, start + width)
        if width < _SHORTEST:
            return start
        share *= 0.5


@njit(nogil=True, error_model="numpy", fastmath=False)
def _one_change(c1: float, c2: float, c3: float, c4: float) -> bool:
    # Whether the signs of 1, c1, .., c4 change once: from some coefficient on none is positive.
    if c1 <= 0.0:
        return c2 <= 0.0 and c3 <= 0.0 and c4 <= 0.0
    if c2 <= 0.0:
        return c3 <= 0.0 and c4 <= 0.0
    return c4 <= 0.0


@njit(nogil=True, error_model="numpy", fastmath=False)
def _zero_between(p1: float, p2: float, p3: float, p4: float, low: float, high: float) -> float:
    # Newton from where a line through the ends crosses, kept inside the bracket by bisection.
    at_low = 1.0 + low * (p1 + low * (p2 + low * (p3 + low * p4)))
    at_high = 1.0 + high * (p1 + high * (p2 + high * (p3 + high * p4)))
    x = low + (high - low) * at_low / (at_low - at_high)
    for _ in range(100):
        g = 1.0 + x * (p1 + x * (p2 + x * (p3 + x * p4)))
        slope = p1 + x * (2.0 * p2 + x * (3.0 * p3 + x * 4.0 * p4))
        low, high = (x, high) if g > 0.0 else (low, x)
        step = g / slope
        inside = low < x - step < high
        x = x - step if inside else 0.5 * (low + high)
        # The error after a Newton step is about the square of the step: the next one would be below rounding.
        if (inside and abs(step) <= 1e-7 * x) or high - low <= 1e-16 * x:
            break
    return x


@njit(nogil=True, error_model="numpy", fastmath=False)
def first_zero_of(bernstein: Floats) -> float:
    """The least x in (0, 1] at which a polynomial is no longer positive, to 1e-12; 2 if there is none.

    ``bernstein`` (n + 1,) are its coefficients on [0, 1], the first one positive.
    """
    rest, start, share = bernstein.copy(), 0.0, 1.0
    left, scratch = np.empty_like(rest), np.empty_like(rest)
    while True:
        _split(rest, share, left, scratch)
        positive = 0
        while positive < len(left) and left[positive] > 0.0:
            positive += 1
        width = share * (1.0 - start)
        if positive == len(left):
            if share == 1.0:
                return _NONE
            start += width
            rest[:], share = scratch, 1.0
        elif left[positive:].max() <= 0.0:
            low, high = 0.0, 1.0
            while (high - low) * width > _SHORTEST:
                middle = 0.5 * (low + high)
                low, high = (middle, high) if _split(left, middle, rest, scratch) > 0.0 else (low, middle)
            return start + 0.5 * (low + high) * width
        elif width < _SHORTEST:
            return start
        else:
            share *= 0.5


@njit(nogil=True, error_model="numpy", fastmath=False)
def _split(bernstein: Floats, share: float, left: Floats, right: Floats) -> float:
    # De Casteljau: coefficients of the first `share` of the interval and of its rest; the value between them.
    right[:] = bernstein
    for order in range(len(bernstein)):
        left[order] = right[0]
        for i in range(len(bernstein) - 1 - order):
            right[i] = (1.0 - share) * right[i] + share * right[i + 1]
    return left[-1]


@njit(nogil=True, error_model="numpy", fastmath=False)
def grown_radius(wanted: float, fold: float, k1: float, k2: float, k3: float, k4: float) -> float:
    """The r in [0, fold] at which r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8), which grows there, is `wanted`."""
    low, high = 0.0, fold
    if not isfinite(high):
        high = max(wanted, 1.0)
        while True:
            s = high * high
            if high * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)))) >= wanted or high > 1e8:
                break
            high *= 2.0
    s = high * high
    if high * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)))) <= wanted:
        return high
    r = min(wanted, 0.5 * high)
    for _ in range(200):
        s = r * r
        error = r * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)))) - wanted
        slope = 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
        low, high = (r, high) if error < 0.0 else (low, r)
        step = error / slope
        inside = low <= r - step <= high
        r = r - step if inside else 0.5 * (low + high)
        if (inside and abs(step) <= 1e-16 * r) or high - low <= 1e-16 * high:
            break
    return r
