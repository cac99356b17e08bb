# pyright: reportMissingTypeStubs=false
"""From a pixel to 3D: the pixel's ray, the LiDAR points in its cone, and the point where the ray meets their plane.

The point X solves two equations of the pixel and one of the plane. Its covariance is that of these three equations
at first order, carried back by the implicit function theorem (Hartley and Zisserman, Multiple View Geometry, 2004,
section 5.2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from workers.geometry.projection import NO_RAY_PX, unproject
from workers.validation.calibration import KnownCalibration

Floats = NDArray[np.float64]
_chi2_tail: Callable[[float, float], float] = special.chdtrc

# Points that are looked at for each pixel, the nearest in the image; the cone holds fewer.
_NEAREST: Final = 1000
# A plane has three parameters, and a fourth point is the first that can contradict it.
_FEWEST: Final = 4
# Share of sound planes that are rejected: one in a thousand.
_FALSE_ALARM: Final = 1e-3
# Radians of tilt, one deviation, up to which first order holds: sin(x) is x to 1 %.
_TILT_RAD: Final = 0.24


@dataclass(frozen=True)
class RangeNoise:
    """Noise of a LiDAR's points: metres along the beam, and radians across it (one deviation each).

    ``shared_m``: metres along the beam by which all points err together, so that no plane through them shows it.
    """

    along_m: float
    across_rad: float
    shared_m: float = 0.0


class FittedPlane(NamedTuple):
    """A plane through points: centre (3,) in metres, unit axes (3, 3) with the normal last, covariance (3, 3).

    The covariance is of the offset along the normal at the centre (m) and of its slopes along the first two axes.
    """

    centre: Floats
    axes: Floats
    covariance: Floats

    def offset_variance(self, point: Floats) -> float:
        """The variance, m^2, of the plane's height at a point (3,) of it."""
        a, b, _ = self.axes @ (point - self.centre)
        here = np.array([1.0, a, b])
        return float(here @ self.covariance @ here)


class PixelPoint(NamedTuple):
    """The point that a pixel shows, in the LiDAR frame.

    Attributes:
        origin, direction: of the ray, (3,) in metres and of unit length.
        direction_covariance: (3, 3), rad^2, from pixel and calibration.
        inside: rows of the points in the cone.
        point, covariance: where the ray meets their plane, (3,) m and (3, 3) m^2; None without a plane.
        normal: of the plane, (3,), towards the camera; None without a plane.
        reason: why there is no plane; empty if there is one.
    """

    origin: Floats
    direction: Floats
    direction_covariance: Floats
    inside: NDArray[np.int64]
    point: Floats | None = None
    covariance: Floats | None = None
    normal: Floats | None = None
    reason: str = ""


def point_of_pixel(
    calibration: KnownCalibration, pixel: Floats, sigma_px: float, points: Floats, noise: RangeNoise, k: float = 3.0
) -> PixelPoint | None:
    """Return the ray of a pixel (2,), and the point of the LiDAR's points (N, 3), metres, LiDAR frame, on it.

    ``sigma_px``: one deviation of the pixel per coordinate. The cone holds the points whose projections lie within
    ``k`` deviations of the pixel, the calibration's own included. None if the lens model has no ray at the pixel.
    """
    rays, miss = unproject(calibration.model, calibration.intrinsics, pixel[None])
    if not miss[0] < NO_RAY_PX:
        return None
    to_lidar = calibration.mount.inverse()
    origin, direction = to_lidar.t, to_lidar.R @ rays[0]
    far, spread = _pixel_equation(calibration, (origin + direction)[None], sigma_px)
    back = np.asarray(np.linalg.pinv(far[0]), np.float64)
    inside = _cone(calibration, pixel, sigma_px, points, k)
    ray = PixelPoint(origin, direction, back @ spread[0] @ back.T, inside)
    plane = _plane(points[inside], noise)
    if isinstance(plane, str):
        return ray._replace(reason=plane)
    normal = plane.axes[2]
    facing = float(normal @ direction)
    # Seen from its edge, the plane's tilt alone decides where the ray meets it.
    if abs(facing) <= 3.0 * np.sqrt(np.trace(plane.covariance[1:, 1:])):
        return ray._replace(reason="the ray runs along the plane of the points")
    along = float(normal @ (plane.centre - origin)) / facing
    if along <= 0.0:
        return ray._replace(reason="the plane of the points lies behind the camera")
    point = origin + along * direction
    by_point, of_pixel = _pixel_equation(calibration, point[None], sigma_px)
    equations = np.vstack([by_point[0], normal])
    errors = np.zeros((3, 3))
    errors[:2, :2], errors[2, 2] = of_pixel[0], plane.offset_variance(point)
    errors[2, 2] += (noise.shared_m * float(normal @ point) / np.linalg.norm(point)) ** 2
    solved = np.linalg.inv(equations)
    # Of second order: where the pixel errs, the plane's tilt lifts the point. Both errors are independent.
    shift = plane.axes[:2] @ solved @ errors @ solved.T @ plane.axes[:2].T
    errors[2, 2] += np.trace(plane.covariance[1:, 1:] @ shift)
    return ray._replace(
        point=point, covariance=solved @ errors @ solved.T, normal=normal if facing < 0.0 else -normal
    )


def _pixel_equation(calibration: KnownCalibration, points: Floats, sigma_px: float) -> tuple[Floats, Floats]:
    """Return derivatives (N, 2, 3), px/m, of projections by points (N, 3), LiDAR frame, and covariances (N, 2, 2)."""
    by_mount, by_names = calibration.jacobians(points)
    spread = np.einsum("nif,fg,njg->nij", by_names, calibration.covariance, by_names)
    return by_mount[:, :, 3:] @ calibration.mount.R, spread + sigma_px**2 * np.eye(2)


def _cone(
    calibration: KnownCalibration, pixel: Floats, sigma_px: float, points: Floats, k: float
) -> NDArray[np.int64]:
    """The rows of the points whose projections lie within k deviations of the pixel."""
    pixels, shown = calibration.project(points)
    rows = np.flatnonzero(shown)
    rows = rows[np.argsort(np.hypot(*(pixels[rows] - pixel).T), kind="stable")[:_NEAREST]]
    difference = pixels[rows] - pixel
    _, spread = _pixel_equation(calibration, points[rows], sigma_px)
    far = np.einsum("ni,nij,nj->n", difference, np.linalg.inv(spread), difference)
    return np.sort(rows[far <= k**2])


def _plane(points: Floats, noise: RangeNoise) -> FittedPlane | str:
    """The plane through points (N, 3), LiDAR frame, or why they have none."""
    if len(points) < _FEWEST:
        return f"{len(points)} points lie in the cone, and a plane needs {_FEWEST}"
    centre: Floats = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - centre)
    try:
        first, _ = _regression(points, centre, axes, noise)
        plane, misfit = _regression(points, first.centre, first.axes, noise)
    except np.linalg.LinAlgError:
        return "the points in the cone lie on one line"
    if float(np.max(np.diag(plane.covariance)[1:])) > _TILT_RAD**2:
        return "the points in the cone lie on one line"
    if _chi2_tail(len(points) - 3.0, misfit) < _FALSE_ALARM:
        return "the points in the cone form no plane"
    return plane


def _regression(points: Floats, centre: Floats, axes: Floats, noise: RangeNoise) -> tuple[FittedPlane, float]:
    """The plane of heights above a centre (3,) along the last of the axes (3, 3), and its chi-square.

    Each height has the variance that its point's noise has along that axis.
    """
    ranges: Floats = np.sqrt(np.sum(points**2, axis=1))
    along: Floats = np.square(points @ axes[2] / ranges)
    deviation: Floats = np.sqrt(along * noise.along_m**2 + (1.0 - along) * (noise.across_rad * ranges) ** 2)
    local: Floats = (points - centre) @ axes.T
    rows: Floats = np.column_stack([np.ones(len(points)), local[:, :2]]) / deviation[:, None]
    heights: Floats = local[:, 2] / deviation
    covariance = np.linalg.inv(rows.T @ rows).astype(np.float64)
    offset, a, b = covariance @ rows.T @ heights
    residuals: Floats = heights - rows @ np.array([offset, a, b])
    normal: Floats = axes[2] - a * axes[0] - b * axes[1]
    normal /= np.linalg.norm(normal)
    first: Floats = axes[0] - (axes[0] @ normal) * normal
    first /= np.linalg.norm(first)
    turned: Floats = np.stack([first, np.cross(normal, first), normal])
    return FittedPlane(centre + offset * axes[2], turned, covariance), float(residuals @ residuals)
