"""nuScenes' tables ``calibrated_sensor`` and ``sensor``: poses in the ego frame, quaternions scalar first.

Its images are undistorted ones.
"""

from __future__ import annotations

import json
from hashlib import sha256
from typing import Any

from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated
from service.exports.format import Files, Format, numbers

Record = dict[str, Any]


def _token(*named: str) -> str:
    """Return a token of 32 hexadecimal digits, as the dataset has them: equal names give equal tokens."""
    return sha256("\0".join(named).encode()).hexdigest()[:32]


def _records(channel: str, modality: str, source: str, pose: SE3, K: list[list[float]]) -> tuple[Record, Record]:
    x, y, z, w = pose.quaternion_xyzw
    sensor = {"token": _token(channel), "channel": channel, "modality": modality}
    calibrated = {
        "token": _token(channel, source),
        "sensor_token": sensor["token"],
        "translation": numbers(pose.t),
        "rotation": numbers([w, x, y, z]),
        "camera_intrinsic": K,
    }
    return sensor, calibrated


def _files(calibrated: Calibrated) -> Files:
    first = calibrated.cameras[0]
    assert first.T_vehicle_lidar is not None
    rows = [_records("LIDAR_TOP", "lidar", first.source, first.T_vehicle_lidar, [])]
    for camera in calibrated.cameras:
        pose = first.T_vehicle_lidar @ camera.T_lidar_camera
        rows.append(_records(f"CAM_{camera.name.upper()}", "camera", camera.source, pose, camera.K))
    sensors, records = zip(*rows, strict=True)
    return {
        "sensor.json": json.dumps(sensors, indent=2) + "\n",
        "calibrated_sensor.json": json.dumps(records, indent=2) + "\n",
    }


FORMAT = Format(
    name="nuscenes",
    title="nuScenes",
    write=_files,
    kind="zip",
    direction="the sensor's pose in the ego frame: T_vehicle_camera, T_vehicle_lidar",
    of_undistorted=True,
    needs_vehicle=True,
    one_lidar=True,
)
