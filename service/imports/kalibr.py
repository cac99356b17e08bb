"""Kalibr's camchain: lenses, and ``T_cn_cnm1``, which maps points of the previous camera into this one. No LiDAR."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from apexcal.geometry.se3 import SE3
from service.imports.contents import Contents, FileCamera, FileLens, matrix, refused, transform
from service.imports.named_lens import lens_of_block

_HINT = "Calibrate as pinhole-radtan or pinhole-equi."


def is_kalibr(document: Mapping[str, Any]) -> bool:
    """Return whether any value of a document is a camera of a camchain."""
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
            cameras.append(
                FileCamera(key[:200], topic and str(topic)[:300], _lens(f"{key} of {name}", member, notes))
            )
        if "T_cn_cnm1" in member and before is not None:
            T = matrix(f"T_cn_cnm1 of {key}", member["T_cn_cnm1"], 4, 4)
            chained.append(transform(key[:200], before, T[:3, :3], T[:3, 3]))
        of_imu = [each for each in ("T_cam_imu", "T_imu_cam") if each in member]
        notes += [f"{each} of {key} is left out: it leads to or from the IMU, not to a LiDAR." for each in of_imu]
        before = key[:200]
    if not cameras:
        raise refused(f"{name} holds no camera with a supported model. {' '.join(notes)}", _HINT)
    return Contents(cameras, chained, notes)


def _lens(where: str, camera: Mapping[str, Any], notes: list[str]) -> FileLens:
    missing = [field for field in ("intrinsics", "distortion_model", "resolution") if field not in camera]
    lens = None if missing else lens_of_block(where, camera, notes)
    if lens is None:
        raise refused(f"{where} has no {' and no '.join(missing or ['four intrinsics'])}.", _HINT)
    return lens
