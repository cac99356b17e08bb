"""Recordings that are trees of files: PCD clouds and JPEG images, and KITTI's raw layout."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.simulation.render import encode_jpeg
from workers.simulation.writers.recording import Channel, Picture
from workers.simulation.writers.ros import POINT, points_of
from workers.simulation.writers.trees import Tree

_SIZES = {"f4": "4", "u2": "2"}


class StampTable:
    """``timestamps.csv``: the columns file and stamp_ns."""

    NAME = "timestamps.csv"

    def __init__(self) -> None:
        self._lines = ["file,stamp_ns"]

    def add(self, file: str, stamp_ns: int) -> None:
        self._lines.append(f"{file},{stamp_ns}")

    def content(self) -> bytes:
        return ("\n".join(self._lines) + "\n").encode()


class CloudsAndImages:
    """A subfolder per sensor with numbered files, and ``timestamps.csv`` at the top."""

    def __init__(self, tree: Tree, cameras: Sequence[Channel]) -> None:
        self.path = tree.path
        self.names = {"lidar": "velodyne", **{camera.name: camera.name for camera in cameras}}
        self._tree = tree
        self._table = StampTable()
        self._count = dict.fromkeys(self.names, 0)

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        self._put("lidar", "pcd", pcd(sweep), sweep.stamp_ns)

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        self._put(camera, "jpg", encode_jpeg(picture.image), picture.stamp_ns)

    def _put(self, sensor: str, suffix: str, data: bytes, stamp_ns: int) -> None:
        name = f"{self.names[sensor]}/{self._count[sensor]:06d}.{suffix}"
        self._count[sensor] += 1
        self._tree.put(name, data)
        self._table.add(name, stamp_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._tree.put(StampTable.NAME, self._table.content())
        self._tree.close()


def pcd(sweep: Sweep) -> bytes:
    """A binary PCD file with the fields of the Velodyne driver's cloud."""
    names = POINT.names or ()
    kinds = [POINT[name].str.lstrip("<") for name in names]
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(names)}\nSIZE {' '.join(_SIZES[kind] for kind in kinds)}\n"
        f"TYPE {' '.join(kind[0].upper() for kind in kinds)}\nCOUNT {' '.join('1' for _ in names)}\n"
        f"WIDTH {len(sweep.xyz)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(sweep.xyz)}\nDATA binary\n"
    )
    return header.encode() + points_of(sweep).tobytes()


class KittiRaw:
    """KITTI's raw layout: a folder of the day, one of the drive, and in it the sensors with their data and times.

    Clouds are x y z reflectance (float32, without rings), ring by ring from the highest down, as the benchmark's are.
    A sweep's time is when the sensor looks ahead; its start and end have files of their own.
    """

    def __init__(self, tree: Tree, cameras: Sequence[Channel], start_ns: int, ahead_ns: int, turn_ns: int) -> None:
        """``ahead_ns``: from a sweep's stamp until the sensor looks ahead; ``turn_ns``: to its last point."""
        day = datetime.fromtimestamp(start_ns // 1_000_000_000, UTC).strftime("%Y_%m_%d")
        self.path = tree.path
        self._drive = f"{day}/{day}_drive_0001_sync"
        folders = {camera.name: f"image_{number:02d}" for number, camera in enumerate(cameras, start=2)}
        self.names = {"lidar": "velodyne_points", **folders}
        self._tree = tree
        self._ahead_ns, self._turn_ns = ahead_ns, turn_ns
        self._times: dict[str, list[str]] = {}
        self._count = dict.fromkeys(self.names, 0)

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        self._put("lidar", "bin", kitti_cloud(sweep))
        for table, after_ns in (("", self._ahead_ns), ("_start", 0), ("_end", self._turn_ns)):
            self._time("lidar", table, sweep.stamp_ns + after_ns)

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        _, data = cv2.imencode(".png", picture.image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        self._put(camera, "png", data.tobytes())
        self._time(camera, "", picture.stamp_ns)

    def _put(self, sensor: str, suffix: str, data: bytes) -> None:
        number = self._count[sensor]
        self._count[sensor] += 1
        self._tree.put(f"{self._drive}/{self.names[sensor]}/data/{number:010d}.{suffix}", data)

    def _time(self, sensor: str, table: str, stamp_ns: int) -> None:
        second = datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M:%S")
        name = f"{self._drive}/{self.names[sensor]}/timestamps{table}.txt"
        self._times.setdefault(name, []).append(f"{second}.{stamp_ns % 1_000_000_000:09d}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name, lines in self._times.items():
            self._tree.put(name, ("\n".join(lines) + "\n").encode())
        self._tree.close()


def kitti_cloud(sweep: Sweep) -> bytes:
    """(N, 4) float32: x y z in metres and a reflectance of 0 to 1; rings from the highest down, each to the right."""
    order: NDArray[np.intp] = np.lexsort((sweep.offset_ns, -sweep.ring.astype(np.int64)))
    rows = np.column_stack([sweep.xyz, np.clip(sweep.intensity / 255.0, 0.0, 1.0)])[order]
    return np.ascontiguousarray(rows, "<f4").tobytes()
