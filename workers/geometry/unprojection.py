"""Back-projection: the ray that a pixel looks along, for every camera model, with its residual."""

from collections.abc import Mapping
from math import cos, hypot, isfinite, sin, sqrt

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from workers.geometry.errors import GeometryError
from workers.geometry.fold_radius import brown_conrady_fold, kannala_brandt_fold
from workers.geometry.models import MODEL_ID, ModelName
from workers.geometry.projection import intrinsics_vector, project_into

Floats = NDArray[np.float64]


def unproject(
    model: ModelName, intrinsics: Mapping[str, float] | ArrayLike, pixels: ArrayLike
) -> tuple[Floats, Floats]:
    """Rays (N, 3) of unit length in the camera frame (optical axes) of pixels (N, 2), and residuals (N,) in px.

    The residual is how far the ray's own projection lies from the pixel: rounding where the ray is one. Where no
    direction inside the model's range is seen there (past the fold of the lens polynomial), the ray is the
    nearest in the radial direction and the residual says by how much it misses: a caller refuses above its own
    limit. `intrinsics` by name, or in INTRINSICS order. cv2.undistortPoints and cv2.fisheye.undistortPoints iterate
    to the same, and say nothing where they fail. Raises GeometryError.
    """
    values = intrinsics_vector(model, intrinsics)
    marks = np.ascontiguousarray(pixels, dtype=np.float64)
    if marks.ndim != 2 or marks.shape[1] != 2 or not np.all(np.isfinite(marks)):
        raise GeometryError("bad_pixels", f"Pixels are finite numbers of shape (N, 2), not {marks.shape}.", "")
    if values[0] == 0.0 or values[1] == 0.0:
        raise GeometryError("bad_intrinsics", "A focal length is zero, so no pixel has a ray.", "Give it in pixels.")
    rays = np.empty((len(marks), 3))
    _unproject_into(MODEL_ID[model], values, marks, rays)
    again, violation = np.empty_like(marks), np.empty(len(marks))
    project_into(MODEL_ID[model], values, rays, again, violation)
    return rays, np.hypot(*(again - marks).T)


@njit(nogil=True, error_model="numpy", cache=True)
def _unproject_into(model_id: int, k: Floats, marks: Floats, rays: Floats) -> None:
    fold = np.inf
    if model_id == 1:
        # A hair inside the fold, where the projection is still one.
        fold = sqrt(brown_conrady_fold(k[5], k[6], k[9])) * (1.0 - 1e-12)
    elif model_id == 2:
        fold = kannala_brandt_fold(k[4], k[5], k[6], k[7]) * (1.0 - 1e-12)
    for i in range(marks.shape[0]):
        y = (marks[i, 1] - k[3]) / k[1]
        x = (marks[i, 0] - k[2]) / k[0]
        if model_id == 2:
            r = hypot(x, y)
            theta = _grown(r, fold, k[4], k[5], k[6], k[7])
            across = sin(theta) / r if r > 0.0 else 0.0
            rays[i, 0], rays[i, 1], rays[i, 2] = x * across, y * across, cos(theta)
            continue
        if model_id == 1:
            x, y = _undistorted(k, x - k[4] * y, y, fold)
        norm = sqrt(1.0 + x * x + y * y)
        rays[i, 0], rays[i, 1], rays[i, 2] = x / norm, y / norm, 1.0 / norm


@njit(nogil=True, error_model="numpy")
def _grown(wanted: float, fold: float, k1: float, k2: float, k3: float, k4: float) -> float:
    # The r in [0, fold] at which r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8), which grows there, is `wanted`.
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


@njit(nogil=True, error_model="numpy")
def _undistorted(k: Floats, x: float, y: float, fold: float) -> tuple[float, float]:
    # The radial part alone gives a start; near the fold, where the tangential part bends most, nearer ones help.
    wanted = hypot(x, y)
    if wanted == 0.0:
        return _newton(k, x, y, fold, 0.0, 0.0)[:2]
    r = _grown(wanted, fold, k[5], k[6], k[9], 0.0) / wanted
    best_a, best_b, error = _newton(k, x, y, fold, x * r, y * r)
    for share in (0.8, 0.6, 0.4):
        if error <= 1e-12 * (1.0 + wanted):
            break
        a, b, now = _newton(k, x, y, fold, x * r * share, y * r * share)
        if now < error:
            best_a, best_b, error = a, b, now
    return best_a, best_b


@njit(nogil=True, error_model="numpy")
def _newton(k: Floats, x: float, y: float, fold: float, a: float, b: float) -> tuple[float, float, float]:
    # Newton on the two equations of the distortion: (a, b) that distort to (x, y), and what is left of the error.
    k1, k2, k3, k4, k5 = k[5], k[6], k[7], k[8], k[9]
    error, best_a, best_b = np.inf, a, b
    for _ in range(60):
        r2 = a * a + b * b
        d = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k5))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k5))
        ea = a * d + 2.0 * k3 * a * b + k4 * (r2 + 2.0 * a * a) - x
        eb = b * d + k3 * (r2 + 2.0 * b * b) + 2.0 * k4 * a * b - y
        now = hypot(ea, eb)
        if now >= error:
            # No nearer: half way back to where it was, until that is rounding.
            a, b = 0.5 * (a + best_a), 0.5 * (b + best_b)
            if hypot(a - best_a, b - best_b) <= 1e-16 * (1.0 + hypot(a, b)):
                break
            continue
        error, best_a, best_b = now, a, b
        aa = d + a * a * slope + 2.0 * k3 * b + 6.0 * k4 * a
        ab = a * b * slope + 2.0 * k3 * a + 2.0 * k4 * b
        bb = d + b * b * slope + 6.0 * k3 * b + 2.0 * k4 * a
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
