"""Recordings that are trees of files: PCD clouds and JPEG images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from workers.readers.recording import Sweep
from workers.simulation.render import encode_jpeg
from workers.simulation.writers.recording import CameraChannel, Picture, RecordingWriter
from workers.simulation.writers.ros import POINT, points_of

_SIZES = {"f4": "4", "u2": "2"}


class StampedFiles:
    """Numbered files of each sensor in a folder, and ``timestamps.csv`` with their stamps at its top."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lines = ["file,stamp_ns"]
        self._count: Counter[str] = Counter()

    def add(self, sensor: str, suffix: str, data: bytes, stamp_ns: int) -> None:
        """``sensor``: the subfolder, with slashes."""
        name = f"{sensor}/{self._count[sensor]:06d}.{suffix}"
        self._count[sensor] += 1
        (self._folder / name).parent.mkdir(parents=True, exist_ok=True)
        (self._folder / name).write_bytes(data)
        self._lines.append(f"{name},{stamp_ns}")

    def close(self) -> None:
        """Write the stamps."""
        (self._folder / "timestamps.csv").write_text("\n".join(self._lines) + "\n", encoding="utf-8")


class CloudsAndImages(RecordingWriter):
    """A subfolder per sensor with numbered files, and ``timestamps.csv`` at the top."""

    def __init__(self, folder: Path, cameras: Sequence[CameraChannel]) -> None:
        super().__init__(folder)
        self.names = {"lidar": "velodyne", **{camera.name: camera.name for camera in cameras}}
        self._files = StampedFiles(folder)

    def write_sweep(self, sweep: Sweep, received_ns: int) -> None:
        """One PCD file."""
        self._files.add(self.names["lidar"], "pcd", pcd(sweep), sweep.stamp_ns)

    def write_picture(self, camera: str, picture: Picture, received_ns: int) -> None:
        """One JPEG file."""
        self._files.add(self.names[camera], "jpg", encode_jpeg(picture.image), picture.stamp_ns)

    def close(self) -> None:
        """Write the stamps."""
        self._files.close()


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
