"""Kalibr's camchain: lenses, and ``T_cn_cnm1``, which maps points of the camera before into this one. No LiDAR.

EuRoC's ``sensor.yaml`` of a camera has the same members under names of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from apexcal.geometry.se3 import SE3
from service.imports.contents import (
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
from service.imports.members import without_distortion

_HINT = "Calibrate as pinhole-radtan or pinhole-equi."


def is_kalibr(document: Mapping[str, Any]) -> bool:
    """Whether any of its values is a camera of a camchain."""
    return any(isinstance(value, dict) and "camera_model" in value for value in document.values())


def read_kalibr(name: str, document: Mapping[str, Any]) -> Contents:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    cameras: list[FileCamera] = []
    chained: list[SE3] = []
    notes: list[str] = []
    before: str | None = None
    for key, member in document.items():
        if not isinstance(member, dict) or "camera_model" not in member:
            continue
        model = str(member["camera_model"])[:40]
        if model != "pinhole":
            notes.append(f"{key} is left out: Kalibr's camera model {model!r} is not supported. {_HINT}")
        else:
            topic = member.get("rostopic")
            cameras.append(FileCamera(key[:200], topic and str(topic)[:300], _lens(f"{key} of {name}", member)))
        if "T_cn_cnm1" in member and before is not None:
            T = matrix(f"T_cn_cnm1 of {key}", member["T_cn_cnm1"], 4, 4)
            chained.append(transform(key[:200], before, T[:3, :3], T[:3, 3]))
        of_imu = [each for each in ("T_cam_imu", "T_imu_cam") if each in member]
        notes += [f"{each} of {key} is left out: it leads to or from the IMU, not to a LiDAR." for each in of_imu]
        before = key[:200]
    if not cameras:
        raise refused(f"{name} holds no camera with a supported model. {' '.join(notes)}", _HINT)
    return Contents(cameras, chained, notes)


def is_euroc(document: Mapping[str, Any]) -> bool:
    """Whether it is the file of a camera of EuRoC's format."""
    return document.get("sensor_type") == "camera" and document.get("camera_model") == "pinhole"


def read_euroc(name: str, document: Mapping[str, Any]) -> Contents:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    member = {**document, "distortion_coeffs": document.get("distortion_coefficients")}
    if document.get("distortion_model") == "radial-tangential":
        member["distortion_model"] = "radtan"
    notes = [f"T_BS of {name} is left out: it leads to the body, not to a LiDAR."] if "T_BS" in document else []
    return Contents([FileCamera("camera", lens=_lens(name, member))], notes=notes)


def _lens(where: str, camera: Mapping[str, Any]) -> FileLens:
    missing = [field for field in ("intrinsics", "distortion_model", "resolution") if field not in camera]
    if not missing and camera["distortion_model"] != "none" and not camera.get("distortion_coeffs"):
        raise without_distortion(where, camera)
    if missing:
        raise refused(f"{where} has no {' and no '.join(missing)}.", "Send the camchain as Kalibr wrote it.")
    f_u, f_v, p_u, p_v = numbers(f"intrinsics of {where}", camera["intrinsics"], 4)
    D = numbers(f"distortion_coeffs of {where}", camera.get("distortion_coeffs") or [])
    size = image_size(f"The images of {where}", *numbers(f"resolution of {where}", camera["resolution"], 2))
    return FileLens(str(camera["distortion_model"])[:64], camera_matrix(f_u, f_v, p_u, p_v), D, size)
