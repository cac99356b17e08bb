"""KITTI's raw recordings: the three ``calib_*.txt`` of a folder of a date, here a folder of a camera.

KITTI's object benchmark: one ``calib.txt`` of rectified images, which here are the undistorted ones.
"""

from __future__ import annotations

from datetime import datetime

import numpy as np

from apexcal.geometry.se3 import SE3, Floats
from service.exports.calibrated import CalibratedCamera
from service.exports.format import RADIAL_TANGENTIAL, Format, each_camera, numbers

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def _line(name: str, values: Floats | list[float]) -> str:
    return f"{name}: {' '.join(map(repr, numbers(values)))}"


def _time(at: datetime) -> str:
    return f"calib_time: {at.day:02d}-{_MONTHS[at.month - 1]}-{at.year} {at:%H:%M:%S}"


def _rigid(camera: CalibratedCamera, T: SE3) -> str:
    return "\n".join([_time(camera.at), _line("R", T.R), _line("T", T.t), ""])


def _velo_to_cam(camera: CalibratedCamera) -> str:
    return _rigid(camera, camera.T_camera_lidar)


def _imu_to_velo(camera: CalibratedCamera) -> str:
    return _rigid(camera, _T_lidar_vehicle(camera))


def _T_lidar_vehicle(camera: CalibratedCamera) -> SE3:  # noqa: N802 - a transform
    """The vehicle's frame takes the place of KITTI's IMU; it is the LiDAR's if no rig states it."""
    return (camera.T_vehicle_lidar or SE3(camera.lidar_frame, camera.lidar_frame)).inverse()


def _cam_to_cam(camera: CalibratedCamera) -> str:
    """Write the camera at each of KITTI's four places, so that a program finds it whichever it reads.

    The rectified image is the undistorted one, with the same K: R_rect is the identity, P_rect is [K | 0].
    """
    size, K = [float(camera.width), float(camera.height)], np.array(camera.K)
    named = (
        ("S", size),
        ("K", K),
        ("D", camera.D),
        ("R", np.eye(3)),
        ("T", np.zeros(3)),
        ("S_rect", size),
        ("R_rect", np.eye(3)),
        ("P_rect", np.c_[K, np.zeros(3)]),
    )
    lines = [_line(f"{name}_{number:02d}", values) for number in range(4) for name, values in named]
    return "\n".join([_time(camera.at), _line("corner_dist", [0.0]), *lines, ""])


def _object(camera: CalibratedCamera) -> str:
    """The camera stands at each of KITTI's four places."""
    P = np.c_[np.array(camera.K), np.zeros(3)]
    named = {
        **{f"P{number}": P for number in range(4)},
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": camera.T_camera_lidar.matrix[:3],
        "Tr_imu_to_velo": _T_lidar_vehicle(camera).matrix[:3],
    }
    return "\n".join([*map(_line, named, named.values()), ""])


# In one folder KITTI's cameras differ by a shift along x alone.
_FILES = {
    "{}/calib_velo_to_cam.txt": _velo_to_cam,
    "{}/calib_imu_to_velo.txt": _imu_to_velo,
    "{}/calib_cam_to_cam.txt": _cam_to_cam,
}
FORMAT = Format(
    name="kitti",
    title="KITTI raw",
    write=each_camera(_FILES),
    kind="zip",
    direction="(R|T)_velo_to_cam maps LiDAR points into the folder's camera",
    lenses=RADIAL_TANGENTIAL,
)
OBJECT = Format(
    name="kitti_object",
    title="KITTI object",
    write=each_camera({"{}/calib.txt": _object}),
    kind="zip",
    direction="Tr_velo_to_cam maps LiDAR points into the folder's camera",
    of_undistorted=True,
)
