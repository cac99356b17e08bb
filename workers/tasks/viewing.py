"""A recording as a file for viewers, from its normalised sensors and its published calibration."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final
from uuid import UUID

import numpy as np
from sqlalchemy import select

from service.platform.db.base import Json
from service.platform.db.recordings import Blob, Recording, Sensor
from service.platform.jobs.claims import Lease
from workers.geometry.models import parse_model
from workers.geometry.projection import project
from workers.readers.limited import write_limited
from workers.tasks.context import Context
from workers.tasks.originals import require_room, watching

# Rows of the undistorted image that are projected at once: 4 MB of rays for 4,000 columns.
_ROWS: Final = 40
_OUTSIDE: Final = -2.0
_MAP_BYTES: Final = 8  # of a pixel


def viewer_file(context: Context, recording: Recording, question: Json, folder: Path, lease: Lease) -> dict[str, Any]:
    """Write the file into ``folder / "copy"`` in a limited child."""
    sensors = _sensors(context, recording.id, [camera["name"] for camera in question["cameras"]])
    pinholes = [camera["pinhole"] for camera in question["cameras"]]
    maps = sum(_MAP_BYTES * pinhole["width"] * pinhole["height"] for pinhole in pinholes)
    require_room(context, shutil.disk_usage(folder).free, sum(size for _, size in sensors.values()) + maps)
    files = {name: _fetched(context, sensor, folder) for name, (sensor, _) in sensors.items()}
    cameras = [
        _camera(camera, files[camera["name"]], folder / "sensors" / str(sensors[camera["name"]][0].id), lease)
        for camera in question["cameras"]
    ]
    poses = [{name: value for name, value in camera.items() if name != "is_new"} for camera in question["poses"]]
    request = {"lidar_frame": question["lidar_frame"], "poses": poses, "facts": question["facts"], "cameras": cameras}
    needed = [Path(camera[name]) for camera in cameras for name in ("file", "map")]
    terms = watching(context, recording, lease, "writing frames and points")
    return write_limited([files["lidar"], *needed], folder / "copy", {"view": request}, **terms)


def _sensors(context: Context, recording_id: UUID, cameras: Sequence[str]) -> dict[str, tuple[Sensor, int]]:
    """The LiDAR and these cameras, each with the size of its file."""
    with context.database.reading() as session:
        rows = session.execute(
            select(Sensor, Blob.size)
            .join(Blob, Blob.key == Sensor.blob_key)
            .where(Sensor.recording_id == recording_id, Sensor.name.in_(["lidar", *cameras]))
        )
        return {sensor.name: (sensor, size) for sensor, size in rows}


def _fetched(context: Context, sensor: Sensor, folder: Path) -> Path:
    target = folder / "sensors" / str(sensor.id)
    target.mkdir(parents=True)
    return context.fetch(sensor.blob_key, target)


def _camera(camera: Json, file: Path, target: Path, lease: Lease) -> dict[str, Any]:
    """A camera as :class:`workers.readers.viewing.viewer_file.ViewedCamera` reads it."""
    undistorting = target / "map.npy"
    write_map(undistorting, camera, lease.check)
    stated = {name: camera[name] for name in ("name", "frame_id", "clock_offset_ns", "raw", "pinhole")}
    return stated | {"file": str(file.resolve()), "map": str(undistorting.resolve())}


def write_map(path: Path, camera: Json, must_stop: Callable[[], None]) -> None:
    """Write (height, width, 2) float32: where in the frame each pixel of the undistorted image is seen."""
    pinhole = camera["pinhole"]
    width, height = pinhole["width"], pinhole["height"]
    f_x, _, c_x, _, f_y, c_y = pinhole["K"][:6]
    pixel_map = np.lib.format.open_memmap(path, "w+", np.float32, (height, width, 2))
    columns = (np.arange(width) - c_x) / f_x
    for first in range(0, height, _ROWS):
        must_stop()
        rows = (np.arange(first, min(first + _ROWS, height)) - c_y) / f_y
        x, y = np.meshgrid(columns, rows)
        rays = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
        pixels, violation = project(parse_model(camera["model"]), camera["intrinsics"], rays)
        # Rays far outside of the frame may give numbers that are too large for the map.
        pixels = np.clip(pixels, _OUTSIDE, [width + 1.0, height + 1.0])
        pixels[violation > 0.0] = _OUTSIDE
        pixel_map[first : first + len(rows)] = pixels.reshape(len(rows), width, 2)
    pixel_map.flush()
