"""The point of a pixel lies where its covariance says, and what is no plane gives none."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from apexcal.geometry.se3 import SE3
from workers.geometry.projection import unproject
from workers.validation.calibration import KnownCalibration
from workers.validation.pixel_points import PixelPoint, RangeNoise, point_of_pixel

NOISE = RangeNoise(along_m=0.01, across_rad=radians(0.02))
SIGMA_PX = 4.0
PIXEL = np.array([700.0, 420.0])
NAMES = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z", "f_x", "f_y")
DEVIATIONS = np.array([*[radians(0.1)] * 3, *[0.01] * 3, 2.0, 2.0])
LENS = np.array([1000.0, 1000.0, 639.5, 479.5])


def calibrated(errors: np.ndarray) -> KnownCalibration:
    """A camera, off by these errors of NAMES, that states their deviations."""
    lens = LENS.copy()
    lens[:2] += errors[6:]
    R = rotation_from_vector(errors[:3]) @ FORWARD_LIDAR_TO_OPTICAL
    mount = SE3("camera", "lidar", R, np.array([0.05, -0.2, -0.1]) + errors[3:6])
    return KnownCalibration("pinhole", lens, (1280, 960), mount, NAMES, np.diag(DEVIATIONS**2))


TRUTH = calibrated(np.zeros(8))


def wall(normal=(1.0, 0.4, 0.1), distance_m=9.0, columns_deg=0.1, rows_deg=0.3) -> np.ndarray:
    """Points (N, 3) of a wall, as a LiDAR's beams meet it."""
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(-10, 10, columns_deg)), np.radians(np.arange(-6, 6, rows_deg))
    )
    beams = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    n = np.array(normal) / np.linalg.norm(normal)
    return beams * (distance_m * n[0] / (beams @ n))[:, None]


def truth(points: np.ndarray) -> np.ndarray:
    """Where the pixel's true ray meets the plane of exact points."""
    to_lidar = TRUTH.mount.inverse()
    direction = to_lidar.R @ unproject(TRUTH.model, TRUTH.intrinsics, PIXEL[None])[0][0]
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][2]
    return to_lidar.t + direction * (normal @ (centre - to_lidar.t)) / (normal @ direction)


def noisy(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    ranges = np.linalg.norm(points, axis=1)[:, None]
    along = points / ranges
    across = rng.normal(0, NOISE.across_rad, points.shape) * ranges
    across -= np.sum(across * along, axis=1)[:, None] * along
    return points + along * rng.normal(0, NOISE.along_m, ranges.shape) + across


def at(points: np.ndarray, calibration: KnownCalibration = TRUTH) -> PixelPoint:
    seen = point_of_pixel(calibration, PIXEL, SIGMA_PX, points, NOISE)
    assert seen is not None
    return seen


def test_the_stated_covariance_holds() -> None:
    """Squared errors over 400 draws, in stated covariances: 3 on average, with deviation sqrt(6 / 400) = 0.12."""
    rng = np.random.default_rng(3)
    exact = wall()
    here = truth(exact)
    squared = []
    for _ in range(400):
        calibration = calibrated(rng.normal(0, DEVIATIONS))
        marked = PIXEL + rng.normal(0, SIGMA_PX, 2)
        seen = point_of_pixel(calibration, marked, SIGMA_PX, noisy(exact, rng), NOISE)
        assert seen is not None
        # Of a thousand sound planes one is called none.
        if seen.point is not None:
            error = seen.point - here
            squared.append(error @ np.linalg.solve(seen.covariance, error))
    assert len(squared) >= 396
    assert np.mean(squared) == pytest.approx(3.0, abs=0.4)
    assert np.mean(np.array(squared) > 11.34) < 0.04  # 0.01 for a normal error; it is a product in part


def test_what_all_ranges_share_is_stated_though_no_plane_shows_it() -> None:
    """Squared errors over 300 draws of an exact wall whose ranges are all off by the same: 1 on average along it."""
    rng = np.random.default_rng(5)
    exact = wall()
    here, noise = truth(exact), replace(NOISE, shared_m=0.03)
    beams = exact / np.linalg.norm(exact, axis=1)[:, None]
    squared = []
    for shift in rng.normal(0, noise.shared_m, 300):
        seen = point_of_pixel(TRUTH, PIXEL, SIGMA_PX, noisy(exact + shift * beams, rng), noise)
        assert seen is not None
        if seen.point is not None:
            along = seen.normal @ (seen.point - here)
            squared.append(along**2 / (seen.normal @ seen.covariance @ seen.normal))
    assert len(squared) >= 297
    assert np.mean(squared) == pytest.approx(1.0, abs=0.25)  # three deviations: 3 sqrt(2 / 300)
    without = point_of_pixel(TRUTH, PIXEL, SIGMA_PX, exact, NOISE)
    stated = point_of_pixel(TRUTH, PIXEL, SIGMA_PX, exact, noise)
    own, all_errors = (point.normal @ point.covariance @ point.normal for point in (without, stated))
    assert own < 0.1 * all_errors


def test_the_point_the_ray_and_the_normal_of_exact_points() -> None:
    exact = wall()
    seen = at(exact)
    assert seen.point == pytest.approx(truth(exact), abs=1e-6)
    assert seen.normal @ seen.direction < 0
    assert np.linalg.norm(np.cross(seen.point - seen.origin, seen.direction)) < 1e-9
    pixels, _ = TRUTH.project(exact[seen.inside])
    assert len(seen.inside) >= 4 and np.hypot(*(pixels - PIXEL).T).max() < 20 * SIGMA_PX


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (wall(columns_deg=5.0, rows_deg=6.0), "a plane needs 4"),
        (wall(rows_deg=24.0), "points lie in the cone"),
        (np.concatenate([wall(), wall(distance_m=5.0)]), "form no plane"),
        (wall()[wall() @ (0.0, 0.0, 1.0) > 0.9], "0 points"),
    ],
    ids=["few", "one ring", "two depths", "elsewhere"],
)
def test_what_forms_no_plane_is_said(points: np.ndarray, reason: str) -> None:
    seen = at(points)
    assert seen.point is None and seen.covariance is None
    assert reason in seen.reason


def test_a_ring_through_the_cone_is_one_line() -> None:
    """The points of one ring, at the elevation where the pixel's ray passes."""
    exact = wall()
    here = truth(exact)
    elevation = np.arctan2(here[2], np.hypot(here[0], here[1]))
    angles = np.arctan2(exact[:, 2], np.hypot(exact[:, 0], exact[:, 1]))
    nearest = angles[np.argmin(np.abs(angles - elevation))]
    assert at(exact[np.abs(angles - nearest) < 1e-6]).reason == "the points in the cone lie on one line"


def test_a_pixel_without_a_ray_has_none() -> None:
    """Past the fold of a lens whose distortion grows no more."""
    lens = np.array([1000.0, 1000.0, 640.0, 480.0, 0.0, -0.4, *[0.0] * 4])
    folded = replace(TRUTH, model="brown_conrady", intrinsics=lens)
    assert point_of_pixel(folded, np.array([2600.0, 480.0]), SIGMA_PX, wall(), NOISE) is None
