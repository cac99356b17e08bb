"""Files of other tools for LiDAR and camera: each states the mount's direction by its name.

direct_visual_lidar_calibration's ``calib.json``, FAST-LIVO2's ``extrin_calib`` with vikit's camera file, and
SensorsCalibration's (OpenCalib) JSON files.
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
    camera_matrix,
    image_size,
    matrix,
    numbers,
    refused,
    transform,
)

_AS_WRITTEN = "Send the file as the other program wrote it."
# Of camera_loader.h: the terms that each camera model takes.
_VIKIT = {
    "Pinhole": ("plumb_bob", ("cam_d0", "cam_d1", "cam_d2", "cam_d3")),
    "EquidistantCamera": ("equidistant", ("k1", "k2", "k3", "k4")),
}


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
    D = numbers(f"distortion_coeffs of {name}", camera["distortion_coeffs"])
    f_x, f_y, c_x, c_y = numbers(f"intrinsics of {name}", camera.get("intrinsics") or [], 4)
    lens = FileLens(str(camera.get("camera_model"))[:64], camera_matrix(f_x, f_y, c_x, c_y), D, None)
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


def is_fast_livo2(document: Mapping[str, Any]) -> bool:
    """Whether it has vikit's name of a camera model, or a mount as FAST-LIVO2 names it."""
    mount = document.get("extrin_calib")
    return "cam_model" in document or (isinstance(mount, dict) and "Rcl" in mount)


def read_fast_livo2(name: str, document: Mapping[str, Any]) -> Contents:
    """Rcl, Pcl map LiDAR points into the camera.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    lens = T_camera_lidar = None
    notes: list[str] = []
    if "cam_model" in document:
        lens = _vikit_lens(name, document)
    else:
        notes.append(f"{name} has no cam_model: send vikit's camera file with it for the lens.")
    mount = document.get("extrin_calib")
    if isinstance(mount, dict) and {"Rcl", "Pcl"} <= set(mount):
        R = matrix(f"Rcl of {name}", mount["Rcl"], 3, 3)
        T_camera_lidar = transform("camera", LIDAR, R, matrix(f"Pcl of {name}", mount["Pcl"], 3))
    else:
        notes.append(f"{name} has no Rcl and Pcl: no mount on the LiDAR is known.")
    return Contents([FileCamera("camera", lens=lens, T_camera_lidar=T_camera_lidar)], notes=notes)


def _vikit_lens(name: str, document: Mapping[str, Any]) -> FileLens:
    model = str(document["cam_model"])[:40]
    if model not in _VIKIT:
        raise refused(f"{name} has the camera model {model}.", f"Known are {' and '.join(_VIKIT)}.")
    distortion_model, terms = _VIKIT[model]
    missing = [term for term in ("cam_fx", "cam_fy", "cam_cx", "cam_cy") if term not in document]
    if missing:
        raise refused(f"{name} has no {' and no '.join(missing)}.", _AS_WRITTEN)
    K = camera_matrix(*(_value(name, document, term) for term in ("cam_fx", "cam_fy", "cam_cx", "cam_cy")))
    D = [_value(name, document, term) for term in terms]
    size = image_size(f"The images of {name}", document.get("cam_width"), document.get("cam_height"))
    return FileLens(distortion_model, K, D, size)


def _value(name: str, document: Mapping[str, Any], term: str) -> float:
    return numbers(f"{term} of {name}", document.get(term, 0.0), 1)[0]


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
