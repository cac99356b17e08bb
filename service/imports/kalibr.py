"""Kalibr's camchain: lenses, and ``T_cn_cnm1``, which maps points of the camera before into this one. No LiDAR."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from apexcal.geometry.se3 import SE3
from service.imports.found import Found, FoundCamera, Lens, camera_matrix, image_size, numbers, refused, transform

_HINT = "Calibrate as pinhole-radtan or pinhole-equi."


def is_kalibr(document: Mapping[str, Any]) -> bool:
    """Whether any of its values is a camera of a camchain."""
    return any(isinstance(one, dict) and "camera_model" in one for one in document.values())


def read_kalibr(name: str, document: Mapping[str, Any]) -> Found:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    cameras: list[FoundCamera] = []
    chained: list[SE3] = []
    notes: list[str] = []
    before: str | None = None
    for key, one in document.items():
        if not isinstance(one, dict) or "camera_model" not in one:
            continue
        model = str(one["camera_model"])[:40]
        if model != "pinhole":
            notes.append(f"{key} is left out: Kalibr's camera model {model!r} is not supported. {_HINT}")
        else:
            topic = one.get("rostopic")
            cameras.append(FoundCamera(key[:200], topic and str(topic)[:300], _lens(f"{key} of {name}", one)))
        if "T_cn_cnm1" in one and before is not None:
            T = np.array(numbers(f"T_cn_cnm1 of {key}", one["T_cn_cnm1"], 16)).reshape(4, 4)
            chained.append(transform(key[:200], before, T[:3, :3], T[:3, 3]))
        if "T_cam_imu" in one:
            notes.append(f"T_cam_imu of {key} is left out: it leads to the IMU, not to a LiDAR.")
        before = key[:200]
    if not cameras:
        raise refused(f"{name} holds no camera with a supported model. {' '.join(notes)}", _HINT)
    return Found(cameras, chained, notes)


def _lens(where: str, one: Mapping[str, Any]) -> Lens:
    missing = [field for field in ("intrinsics", "distortion_model", "resolution") if field not in one]
    if missing:
        raise refused(f"{where} has no {' and no '.join(missing)}.", "Send the camchain as Kalibr wrote it.")
    K = camera_matrix(*_focal_first(numbers(f"intrinsics of {where}", one["intrinsics"], 4)))
    D = numbers(f"distortion_coeffs of {where}", one.get("distortion_coeffs") or [])
    size = image_size(f"The images of {where}", *numbers(f"resolution of {where}", one["resolution"], 2))
    return Lens(str(one["distortion_model"])[:64], K, D, size)


def _focal_first(values: list[float]) -> tuple[float, float, float, float]:
    f_u, f_v, p_u, p_v = values
    return f_u, f_v, p_u, p_v
