"""Points in 3D that pixels of a camera show at one moment."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from apexcal.documents.pixel_points import LidarNoise, LocatedPixel, LocatedPixels, UncertainPixel
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.recordings import CameraFrame
from service.platform.jobs.claims import Claim, Lease
from workers.readers.normalised.sensor_files import SweepFile
from workers.readers.recording import ReadError
from workers.tasks.context import Context
from workers.tasks.originals import camera_of, lidar_key, open_lidar
from workers.tasks.validating import check_image_size
from workers.validation.calibration import KnownCalibration
from workers.validation.drive_check import seen_after_ns
from workers.validation.pixel_points import PixelPoint, RangeNoise, point_of_pixel

# A sweep of the slowest sensor, 5 Hz (data sheets: 5 to 20 Hz): a moment farther from every sweep lies in a gap.
_LONGEST_SWEEP_NS: Final = 200_000_000


def pixel_points(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Json]:
    """The ray of each pixel, the points in its cone, and where their plane meets it."""
    lease.report(0.0, "looking along the rays")
    with context.database.reading() as session:
        row = session.get_one(Analysis, claim.subject_id)
        question, key = row.asked, lidar_key(session, row.recording_id)
        calibration = KnownCalibration.of(question["calibration"])
        stamp_ns = _camera_stamp_ns(session, row, calibration) - question["clock_offset_ns"]
    with context.scratch() as folder, open_lidar(context, key, folder) as lidar:
        index = _sweep_of(lidar, stamp_ns - seen_after_ns(lidar, calibration), stamp_ns)
        sweep = lidar.sweep(index)
    points = sweep.xyz.astype(np.float64)
    stated = LidarNoise.model_validate(question["lidar_noise"])
    noise = RangeNoise(stated.range_m, float(np.radians(stated.angle_deg)), stated.shared_m)
    located = [
        _located(calibration, UncertainPixel.model_validate(pixel), points, noise, question["k"])
        for pixel in question["pixels"]
    ]
    result = LocatedPixels(sweep=index, sweep_stamp_ns=sweep.stamp_ns, pixels=located).model_dump()
    return lambda session: result


def _camera_stamp_ns(session: Session, row: Analysis, calibration: KnownCalibration) -> int:
    """The moment by the camera's clock. Raises ReadError ``image_size_differs``, by the frame nearest to it."""
    camera = camera_of(session, row.recording_id, row.asked["camera"])
    frames = select(CameraFrame).where(CameraFrame.sensor_id == camera.id)
    index, stamp_ns = row.asked["frame"], row.asked["stamp_ns"]
    if index is not None:
        frame = session.scalars(frames.where(CameraFrame.index == index)).one()
        stamp_ns = frame.stamp_ns
    else:
        frame = session.scalars(frames.order_by(func.abs(CameraFrame.stamp_ns - stamp_ns)).limit(1)).first()
    check_image_size(camera, [frame] if frame else [], calibration)
    return int(stamp_ns)


def _sweep_of(lidar: SweepFile, sweep_stamp_ns: int, moment_ns: int) -> int:
    """The number of the sweep of a moment. Raises ReadError ``no_sweep_then``."""
    index = lidar.nearest(sweep_stamp_ns)
    off_ns = abs(int(lidar.stamps_ns[index]) - sweep_stamp_ns)
    if off_ns > max(lidar.sweep_ns, _LONGEST_SWEEP_NS):
        raise ReadError(
            "no_sweep_then",
            f"The LiDAR's nearest sweep is {off_ns / 1e9:.2f} s away from the moment {moment_ns} ns of its clock.",
            "Give a frame, or a stamp, at which the LiDAR recorded; check clock_offset_ns.",
        )
    return index


def _located(
    calibration: KnownCalibration, pixel: UncertainPixel, points: NDArray[np.float64], noise: RangeNoise, k: float
) -> LocatedPixel:
    at = np.array([pixel.u, pixel.v])
    if not calibration.shows(at[None], np.zeros(1))[0]:
        width, height = calibration.image_size
        return LocatedPixel(u=pixel.u, v=pixel.v, reason=f"the pixel lies outside of the image, {width} x {height}")
    point = point_of_pixel(calibration, at, pixel.sigma_px, points, noise, k)
    if point is None:
        return LocatedPixel(u=pixel.u, v=pixel.v, reason="the lens model has no ray at the pixel")
    return LocatedPixel(u=pixel.u, v=pixel.v, points=_rounded(points[point.inside]), **_members(point))


def _members(point: PixelPoint) -> Json:
    shown = ("origin", "direction", "direction_covariance", "point", "covariance", "normal")
    arrays = {name: getattr(point, name) for name in shown}
    return {name: None if values is None else values.tolist() for name, values in arrays.items()} | {
        "reason": point.reason or None
    }


def _rounded(points: NDArray[np.float64]) -> list[list[float]]:
    """Round to a tenth of the finest range step of the supported sensors, 1 mm."""
    rows: list[list[float]] = np.round(points, 4).tolist()
    return rows
