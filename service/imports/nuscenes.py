"""nuScenes' tables: ``calibrated_sensor.json``, poses of sensors in the ego frame, and ``sensor.json``, their names.

Its images are undistorted ones. A dataset has many logs, each with its own poses: ``sample_data.json`` tells by which
of them a file was recorded, and how large its images are.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import TypeAdapter, ValidationError

from apexcal.documents.errors import GeometryError
from apexcal.geometry.rotations import rotation_from_quaternion
from apexcal.geometry.se3 import SE3
from service.imports.contents import Contents, FileCamera, FileLens, image_size, matrix, numbers, refused, transform
from service.imports.yaml_text import read_yaml

Record = Mapping[str, Any]
_EGO = "ego"
_TABLE = TypeAdapter(list[dict[str, Any]])
_AS_WRITTEN = "Send calibrated_sensor.json and sensor.json together, as the dataset has them."


def is_nuscenes(text: str) -> bool:
    """Whether a text is one of the three tables."""
    names = ('"sensor_token"', '"calibrated_sensor_token"', '"modality"')
    return text.lstrip().startswith("[") and any(name in text[:2000] for name in names)


def of_recording(texts: Mapping[str, str], recording: Path) -> dict[str, str]:
    """The tables with the poses by which a folder's files were recorded, where ``sample_data.json`` is among them.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    tables = {name: _rows(name, text) for name, text in texts.items() if is_nuscenes(text)}
    of_files = [name for name, rows in tables.items() if any("calibrated_sensor_token" in row for row in rows)]
    if not of_files:
        return dict(texts)
    files = {path.name for path in recording.rglob("*")} if recording.is_dir() else set[str]()
    sizes: dict[str, dict[str, int]] = {}
    for row in (row for name in of_files for row in tables[name]):
        if PurePosixPath(str(row.get("filename"))).name in files:
            size = {side: row[side] for side in ("width", "height") if row.get(side)}
            sizes[str(row.get("calibrated_sensor_token"))] = size
    if not sizes:
        raise refused(
            f"{' and '.join(of_files)} names no file of {recording.name}.", "Name the tables of its own dataset."
        )
    chosen = {
        name: json.dumps([
            row | sizes.get(str(row.get("token")), {})
            for row in rows
            if "modality" in row or str(row.get("token")) in sizes
        ])
        for name, rows in tables.items()
    }  # fmt: skip
    return {name: chosen.get(name, text) for name, text in texts.items() if name not in of_files}


def read_nuscenes(files: Mapping[str, str]) -> Contents:
    """Cameras by their channels (``CAM_FRONT``), with mounts on the LiDAR.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    channels: dict[str, str] = {}
    records: list[Record] = []
    for name, text in files.items():
        for row in read_yaml(name, text).values():
            if "channel" in row:
                channels[str(row.get("token"))] = str(row["channel"])
            elif "sensor_token" in row:
                records.append(row)
    if not channels or not records:
        raise refused(f"{' and '.join(files)} holds poses or names of nuScenes' sensors, not both.", _AS_WRITTEN)
    of_channel: dict[str, Record] = {}
    for record in records:
        channel = channels.get(str(record["sensor_token"]), "")
        other = of_channel.setdefault(channel, record)
        if any(other.get(name) != record.get(name) for name in ("translation", "rotation", "camera_intrinsic")):
            raise refused(
                f"{' and '.join(files)} has several poses of {channel}: the dataset has one for each log.",
                "Keep those of the recording's log (rotation w x y z and translation: the sensor in the ego frame), "
                "or let `apexcal check FOLDER` choose: name sample_data.json too.",
            )
    lidars = [channel for channel in of_channel if "LIDAR" in channel.upper()]
    if len(lidars) != 1:
        raise refused(f"{' and '.join(files)} has {len(lidars)} LiDARs.", "Keep the records of one LiDAR.")
    T_ego_lidar = _pose(lidars[0], of_channel[lidars[0]])
    cameras: list[FileCamera] = []
    for channel, record in of_channel.items():
        if record.get("camera_intrinsic"):
            T_camera_lidar = _pose(channel, record).inverse() @ T_ego_lidar
            cameras.append(FileCamera(channel, lens=_lens(channel, record), T_camera_lidar=T_camera_lidar))
    return Contents(cameras)


def _lens(channel: str, record: Record) -> FileLens:
    K = matrix(f"camera_intrinsic of {channel}", record["camera_intrinsic"], 9).tolist()
    sides = record.get("width"), record.get("height")
    return FileLens("plumb_bob", K, [], image_size(f"The images of {channel}", *sides) if None not in sides else None)


def _pose(channel: str, record: Record) -> SE3:
    """T_ego_sensor."""
    w, x, y, z = numbers(f"rotation of {channel}", record.get("rotation"), 4)
    try:
        R = rotation_from_quaternion([x, y, z, w])
    except GeometryError as error:
        raise refused(f"The rotation of {channel} is none. {error.message}", _AS_WRITTEN) from None
    return transform(_EGO, channel, R, matrix(f"translation of {channel}", record.get("translation"), 3))


def _rows(name: str, text: str) -> list[dict[str, Any]]:
    try:
        return _TABLE.validate_json(text)
    except ValidationError as error:
        raise refused(f"{name} is no table: {error.errors()[0]['msg']}.", _AS_WRITTEN) from None
