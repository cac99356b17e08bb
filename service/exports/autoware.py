"""Autoware's ``individual_params`` tree: poses as x y z (metres) and roll pitch yaw (radians) below their parents."""

from __future__ import annotations

import json

import numpy as np

from service.exports.calibrated import Calibrated, CalibratedCamera, file_name
from service.exports.camera_info import camera_info
from service.exports.format import Files, Format
from service.exports.transform import Transform, numbers, yaml_number

_KIT = "sensor_kit_base_link"
_OPTICAL, _BODY = "camera_optical_link", "camera_link"


def _optical_from_body(optical: str, body: str) -> Transform:
    # Autoware's camera description turns camera_link (x forward, y left, z up) into its optical link by itself.
    return Transform(optical, body, np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.zeros(3))


def _body(camera: CalibratedCamera) -> Transform:
    """The pose of the camera's ``camera_link`` in the LiDAR's frame."""
    frame = camera.frame
    body = frame.replace(_OPTICAL, _BODY) if frame.endswith(_OPTICAL) else f"{file_name(camera.name)}/{_BODY}"
    return camera.T_lidar_camera.after(_optical_from_body(frame, body))


def _tree(parent: str, poses: list[Transform]) -> str:
    lines = [f"{json.dumps(parent, ensure_ascii=False)}:"]
    for pose in poses:
        named = zip(("x", "y", "z", "roll", "pitch", "yaw"), numbers([*pose.t, *pose.roll_pitch_yaw]), strict=True)
        lines += [
            f"  {json.dumps(pose.from_frame, ensure_ascii=False)}:",
            *(f"    {name}: {yaml_number(value)}" for name, value in named),
        ]
    return "\n".join(lines) + "\n"


def _files(calibrated: Calibrated) -> Files:
    """The sensor kit lies on the LiDAR's frame, or is the frame to which the rig's T_vehicle_lidar leads."""
    first = calibrated.cameras[0]
    T_vehicle_lidar = first.T_vehicle_lidar
    assert T_vehicle_lidar is not None
    folder = f"individual_params/config/{file_name(calibrated.vehicle)}/{file_name(first.rig)}"
    bodies = [_body(camera) for camera in calibrated.cameras]
    files = {
        f"{folder}/{file_name(camera.name)}.camera_info.yaml": camera_info(camera) for camera in calibrated.cameras
    }
    if T_vehicle_lidar.to_frame == _KIT:
        in_kit = [T_vehicle_lidar, *(T_vehicle_lidar.after(body) for body in bodies)]
    else:
        on_vehicle = Transform(T_vehicle_lidar.to_frame, _KIT, T_vehicle_lidar.R, T_vehicle_lidar.t)
        files[f"{folder}/sensors_calibration.yaml"] = _tree(T_vehicle_lidar.to_frame, [on_vehicle])
        in_kit = [Transform(_KIT, first.lidar_frame, np.eye(3), np.zeros(3)), *bodies]
    return {**files, f"{folder}/sensor_kit_calibration.yaml": _tree(_KIT, in_kit)}


FORMAT = Format(
    name="autoware",
    title="Autoware",
    write=_files,
    kind="zip",
    direction="the child's pose in its parent, cameras as camera_link (x forward)",
    needs_vehicle=True,
    one_lidar=True,
)
