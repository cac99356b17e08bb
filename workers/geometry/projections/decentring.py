"""The inverse of a radial polynomial with decentring (Brown 1966), in coordinates that suit the radial model.

(a, b) goes to (a d + 2 p1 a b + p2 (s + 2 a^2), b d + p1 (s + 2 b^2) + 2 p2 a b), where s = a^2 + b^2 and
d = 1 + k1 s + k2 s^2 + k3 s^3 + k4 s^4. p1 and p2 are OpenCV's.
"""

from math import hypot

import numpy as np
from numba import njit

from workers.geometry.fold_radius import grown_radius


@njit(nogil=True, error_model="numpy")
def undistorted(
    x: float, y: float, fold: float, k1: float, k2: float, k3: float, k4: float, p1: float, p2: float
) -> tuple[float, float]:
    """The (a, b), at most `fold` from the centre, that goes to (x, y); where there is none, one that comes near."""
    wanted = hypot(x, y)
    if wanted == 0.0:
        return _newton(x, y, fold, k1, k2, k3, k4, p1, p2, 0.0, 0.0)[:2]
    # The radial part alone gives a start; near the fold, where the tangential part bends most, nearer ones help.
    r = grown_radius(wanted, fold, k1, k2, k3, k4) / wanted
    if p1 == 0.0 and p2 == 0.0:
        return x * r, y * r
    best_a, best_b, error = _newton(x, y, fold, k1, k2, k3, k4, p1, p2, x * r, y * r)
    for share in (0.8, 0.6, 0.4):
        if error <= 1e-12 * (1.0 + wanted):
            break
        a, b, now = _newton(x, y, fold, k1, k2, k3, k4, p1, p2, x * r * share, y * r * share)
        if now < error:
            best_a, best_b, error = a, b, now
    return best_a, best_b


@njit(nogil=True, error_model="numpy")
def bend_slopes(
    a: float, b: float, k1: float, k2: float, k3: float, k4: float, p1: float, p2: float
) -> tuple[float, float, float, float, float]:
    """Where (a, b) goes, and the derivatives: of the first by a, of the first by b (or second by a), of the second
    by b.
    """
    s = a * a + b * b
    d = 1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4)))
    slope = 2.0 * (k1 + s * (2.0 * k2 + s * (3.0 * k3 + s * 4.0 * k4)))
    return (
        a * d + 2.0 * p1 * a * b + p2 * (s + 2.0 * a * a),
        b * d + p1 * (s + 2.0 * b * b) + 2.0 * p2 * a * b,
        d + a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a,
        a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b,
        d + b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a,
    )


@njit(nogil=True, error_model="numpy")
def _newton(
    x: float, y: float, fold: float, k1: float, k2: float, k3: float, k4: float, p1: float, p2: float,
    a: float, b: float,
) -> tuple[float, float, float]:  # fmt: skip
    # Newton on the two equations of the distortion: (a, b) that distort to (x, y), and what is left of the error.
    error, best_a, best_b = np.inf, a, b
    for _ in range(60):
        a_d, b_d, aa, ab, bb = bend_slopes(a, b, k1, k2, k3, k4, p1, p2)
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
