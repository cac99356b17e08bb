"""Files of other tools for LiDAR and camera: each states the mount's direction by its name.

direct_visual_lidar_calibration's ``calib.json``, and SensorsCalibration's (OpenCalib) JSON files.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from apexcal.documents.errors import GeometryError
from apexcal.geometry.rotations import rotation_from_quaternion
from apexcal.geometry.se3 import SE3
from service.imports.contents import (
    LIDAR,
    Contents,
    FileCamera,
    FileLens,
    image_size,
    matrix,
    numbers,
    refused,
    transform,
)
from service.imports.named_lens import lens_of_block

_AS_WRITTEN = "Send the file as the other program wrote it."


def is_direct_visual(document: Mapping[str, Any]) -> bool:
    """Whether it has a camera with coefficients as ``calib.json`` names them."""
    camera = document.get("camera")
    return isinstance(camera, dict) and "distortion_coeffs" in camera


def read_direct_visual(name: str, document: Mapping[str, Any]) -> Contents:
    """p_lidar = T_lidar_camera p_camera, as x y z qx qy qz qw; the first guesses are left out.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    camera, results = document["camera"], document.get("results")
    lens = lens_of_block(f"camera of {name}", camera, [])
    if lens is None:
        raise refused(f"{name} has no four intrinsics.", _AS_WRITTEN)
    values = results.get("T_lidar_camera") if isinstance(results, dict) else None
    if values is None:
        notes = [f"{name} has no results.T_lidar_camera: no mount on the LiDAR is known."]
        return Contents([FileCamera("camera", lens=lens)], notes=notes)
    *t, x, y, z, w = numbers(f"T_lidar_camera of {name}", values, 7)
    try:
        R = rotation_from_quaternion([x, y, z, w])
    except GeometryError as error:
        raise refused(f"T_lidar_camera of {name} is no pose. {error.message}", _AS_WRITTEN) from None
    pose = transform(LIDAR, "camera", R, np.array(t))
    return Contents([FileCamera("camera", lens=lens, T_camera_lidar=pose.inverse())])


def is_sensors_calibration(document: Mapping[str, Any]) -> bool:
    """Whether any of its values is a sensor's or two sensors' parameters."""
    return any(isinstance(value, dict) and {"param_type", "param"} <= set(value) for value in document.values())


def read_sensors_calibration(name: str, document: Mapping[str, Any]) -> Contents:
    """``A-to-B-extrinsic`` maps points of A into B; a lens is of the camera that its entry names.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    lenses: dict[str, FileLens] = {}
    mounts: dict[str, SE3] = {}
    for key, entry in document.items():
        param = entry.get("param") if isinstance(entry, dict) else None
        if not isinstance(param, dict):
            continue
        where = f"{key[:80]} of {name}"
        if "cam_K" in param:
            K, D = (numbers(f"{member} of {where}", param.get(member)) for member in ("cam_K", "cam_dist"))
            size = image_size(f"The images of {where}", param.get("img_dist_w"), param.get("img_dist_h"))
            lenses[str(entry.get("sensor_name"))[:200]] = FileLens("plumb_bob", numbers(where, K, 9), D, size)
        elif "sensor_calib" in param:
            T = matrix(f"sensor_calib of {where}", param["sensor_calib"], 4, 4)
            to_frame, from_frame = (str(entry.get(end))[:200] for end in ("target_sensor_name", "sensor_name"))
            mounts[to_frame] = transform(to_frame, from_frame, T[:3, :3], T[:3, 3])
    cameras = [
        FileCamera(camera, lens=lenses.get(camera), T_camera_lidar=mounts.get(camera))
        for camera in dict.fromkeys([*lenses, *mounts])
    ]
    if not cameras:
        raise refused(f"{name} has neither a cam_K nor a sensor_calib.", _AS_WRITTEN)
    return Contents(cameras)
