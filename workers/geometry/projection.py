"""Projection of camera-frame points and back in double precision, and what a forbidden projection costs."""

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.errors import GeometryError
from workers.geometry.models import INTRINSICS, ModelName, parse_model
from workers.geometry.projections.table import PROJECTIONS

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
    PROJECTIONS[model].project_into(values, points, pixels, violation)
    pixels[violation > 0.0] = np.nan
    return pixels, violation


NO_RAY_PX: Final = 0.1
"""If the projection of a pixel's ray misses the pixel by more, the lens model has no ray there."""


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
    PROJECTIONS[model].rays_into(values, marks, rays)
    again, violation = np.empty_like(marks), np.empty(len(marks))
    PROJECTIONS[model].project_into(values, rays, again, violation)
    return rays, np.hypot(*(again - marks).T)


def violation_cost_px(violation: ArrayLike, diagonal_px: float) -> Floats:
    """Return a forbidden projection's cost in pixels: at least the image's diagonal, growing with the violation."""
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
    return PROJECTIONS[model].fold_angle(intrinsics_vector(model, intrinsics))


def intrinsics_vector(model: ModelName, intrinsics: Mapping[str, float] | ArrayLike) -> Floats:
    """The intrinsics as float64 in INTRINSICS order; distortion terms not named are 0. Raises GeometryError."""
    names = INTRINSICS[parse_model(model)]
    if isinstance(intrinsics, Mapping):
        missing = [name for name in names[:4] if name not in intrinsics]
        if missing:
            raise GeometryError(
                "missing_intrinsics", f"The intrinsics of {model} lack {', '.join(missing)}.", "Give them in pixels."
            )
        by_name: Mapping[str, Any] = intrinsics
        values = np.array([float(by_name.get(name, 0.0)) for name in names])
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
