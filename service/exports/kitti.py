"""KITTI's raw recordings: ``calib_velo_to_cam.txt`` and ``calib_cam_to_cam.txt``, cameras numbered as in the rig."""

from __future__ import annotations

from datetime import datetime

import numpy as np

from service.exports.calibrated import Calibrated, CalibratedCamera
from service.exports.format import RADIAL_TANGENTIAL, Files, Format
from service.exports.transform import Floats, Transform, numbers

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def _line(name: str, values: Floats | list[float]) -> str:
    return f"{name}: {' '.join(map(repr, numbers(values)))}"


def _time(at: datetime) -> str:
    return f"calib_time: {at.day:02d}-{_MONTHS[at.month - 1]}-{at.year} {at:%H:%M:%S}"


def _velo_to_cam(first: CalibratedCamera) -> str:
    """(R|T) maps LiDAR points into camera 00."""
    mount = first.T_camera_lidar
    lines = [_time(first.at), _line("R", mount.R), _line("T", mount.t)]
    return "\n".join([*lines, _line("delta_f", [0.0, 0.0]), _line("delta_c", [0.0, 0.0]), ""])


def _camera(place: int, camera: CalibratedCamera, T_camera_first: Transform) -> list[str]:
    """R, T map points of camera 00 into this one. The rectified image is the undistorted one, with the same K.

    So P_rect = K [R | T], and the devkit's P_rect_xx R_rect_00 (R|T)_velo_to_cam X holds in undistorted images.
    """
    size, K = [float(camera.width), float(camera.height)], np.array(camera.K)
    named = (
        ("S", size),
        ("K", K),
        ("D", camera.D),
        ("R", T_camera_first.R),
        ("T", T_camera_first.t),
        ("S_rect", size),
        ("R_rect", np.eye(3)),
        ("P_rect", K @ T_camera_first.matrix[:3]),
    )
    return [_line(f"{name}_{place:02d}", values) for name, values in named]


def _files(calibrated: Calibrated) -> Files:
    first = calibrated.cameras[0]
    lines = [_time(first.at), _line("corner_dist", [0.0])]
    for place, camera in enumerate(calibrated.cameras):
        lines += _camera(place, camera, camera.T_camera_lidar.after(first.T_camera_lidar.inverse()))
    # Behind the rest: some readers count lines.
    lines += [f"name_{place:02d}: {camera.name}" for place, camera in enumerate(calibrated.cameras)]
    return {"calib_velo_to_cam.txt": _velo_to_cam(first), "calib_cam_to_cam.txt": "\n".join([*lines, ""])}


FORMAT = Format(
    name="kitti",
    title="KITTI raw",
    write=_files,
    kind="zip",
    direction="(R|T)_velo_to_cam maps LiDAR points into camera 00; R_xx, T_xx map camera 00 into camera xx",
    lenses=RADIAL_TANGENTIAL,
    one_lidar=True,
)
