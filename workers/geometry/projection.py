"""Projection of camera-frame points in double precision, and what a forbidden projection costs."""

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from workers.geometry.camera_kernels import (
    brown_conrady_point,
    kannala_brandt_point,
    pinhole_point,
)
from workers.geometry.errors import GeometryError
from workers.geometry.fold_radius import brown_conrady_fold, kannala_brandt_fold
from workers.geometry.models import INTRINSICS, MODEL_ID, ModelName, parse_model

Floats = NDArray[np.float64]


def project(
    model: ModelName, intrinsics: Mapping[str, float] | ArrayLike, points_camera: ArrayLike
) -> tuple[Floats, Floats]:
    """Project points (N, 3), metres, camera frame. Returns pixels (N, 2) and violation (N,), both float64.

    violation is 0 for a good projection. Behind the camera, and past the radius where the distortion stops
    growing, it is positive and grows; the pixel there is not a number, because a formula that is continued past
    its range returns plausible pixels for such points (cv2 does). `intrinsics` by name, or in INTRINSICS order.
    Agrees with cv2.projectPoints and cv2.fisheye.projectPoints wherever those are right (cv2 ignores skew).
    Raises GeometryError.
    """
    values = intrinsics_vector(model, intrinsics)
    points = points_array(points_camera)
    pixels = np.empty((len(points), 2))
    violation = np.empty(len(points))
    project_into(MODEL_ID[model], values, points, pixels, violation)
    pixels[violation > 0.0] = np.nan
    return pixels, violation


def violation_cost_px(violation: ArrayLike, diagonal_px: float) -> Floats:
    """What a forbidden projection counts in pixels: at least the image's diagonal, growing with the violation."""
    amount = np.asarray(violation, dtype=np.float64)
    return np.where(amount > 0.0, diagonal_px * (1.0 + amount), 0.0)


def distances_px(pixels: ArrayLike, violation: ArrayLike, marks: ArrayLike, diagonal_px: float) -> Floats:
    """Distance (N,) in pixels of projections (N, 2) from marks (N, 2), the violation's cost where there is one."""
    difference = np.asarray(pixels, dtype=np.float64) - np.asarray(marks, dtype=np.float64)
    bad = np.asarray(violation) > 0.0
    distance = np.hypot(difference[:, 0], difference[:, 1])
    return np.where(bad, violation_cost_px(violation, diagonal_px), distance)


def image_diagonal_px(image_size: Sequence[float]) -> float:
    """Length of the image's diagonal of (width, height) in pixels."""
    return hypot(image_size[0], image_size[1])


def fold_angle(model: ModelName, intrinsics: Mapping[str, float] | ArrayLike) -> float:
    """Angle from the optical axis in radians up to which the model may be used."""
    values = intrinsics_vector(model, intrinsics)
    if model == "kannala_brandt":
        return float(kannala_brandt_fold(values[4], values[5], values[6], values[7]))
    if model == "brown_conrady":
        return float(np.arctan(np.sqrt(brown_conrady_fold(values[5], values[6], values[9]))))
    return float(np.pi / 2)


def intrinsics_vector(model: ModelName, intrinsics: Mapping[str, float] | ArrayLike) -> Floats:
    """The intrinsics as float64 in INTRINSICS order; distortion terms not named are 0. Raises GeometryError."""
    names = INTRINSICS[parse_model(model)]
    if isinstance(intrinsics, Mapping):
        missing = [name for name in names[:4] if name not in intrinsics]
        if missing:
            raise GeometryError(
                "missing_intrinsics", f"The intrinsics of {model} lack {', '.join(missing)}.", "Give them in pixels."
            )
        given: Mapping[str, Any] = intrinsics
        values = np.array([float(given.get(name, 0.0)) for name in names])
    else:
        values = np.ascontiguousarray(intrinsics, dtype=np.float64)
    if values.shape != (len(names),) or not np.all(np.isfinite(values)):
        raise GeometryError(
            "bad_intrinsics", f"{model} takes {len(names)} finite numbers.", f"They are {', '.join(names)}."
        )
    return values


def points_array(points: ArrayLike) -> Floats:
    """Points as contiguous float64 (N, 3). Raises GeometryError `bad_points`."""
    array = np.ascontiguousarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or not np.all(np.isfinite(array)):
        raise GeometryError("bad_points", f"Points are finite numbers of shape (N, 3), not {array.shape}.", "")
    return array


@njit(nogil=True, error_model="numpy", cache=True)
def project_into(model_id: int, k: Floats, points: Floats, pixels: Floats, violation: Floats) -> None:
    """The loop of `project`: fills pixels (N, 2) and violation (N,); pixels are finite-or-wild where violated."""
    n = points.shape[0]
    if model_id == 0:
        for i in range(n):
            pixels[i, 0], pixels[i, 1], violation[i] = pinhole_point(
                points[i, 0], points[i, 1], points[i, 2], k[0], k[1], k[2], k[3]
            )
    elif model_id == 1:
        fold_r2 = brown_conrady_fold(k[5], k[6], k[9])
        for i in range(n):
            pixels[i, 0], pixels[i, 1], violation[i] = brown_conrady_point(
                points[i, 0], points[i, 1], points[i, 2],
                k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], fold_r2,
            )  # fmt: skip
    else:
        fold_theta = kannala_brandt_fold(k[4], k[5], k[6], k[7])
        for i in range(n):
            pixels[i, 0], pixels[i, 1], violation[i] = kannala_brandt_point(
                points[i, 0], points[i, 1], points[i, 2],
                k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], fold_theta,
            )  # fmt: skip
