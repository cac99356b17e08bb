"""A folder of PCD files and images, or an uncompressed tar of one: a subfolder per sensor, or all in one."""

from __future__ import annotations

import heapq
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Final, Literal

import numpy as np

from workers.readers.clouds import SAMPLES, CloudModel, Columns, learn_clouds
from workers.readers.file_times import CSV_NAME, FileTimes, stamp_files, stem_and_number
from workers.readers.file_tree import FileTree, Folder, Tar
from workers.readers.images import read_image_header
from workers.readers.pcd import read_pcd
from workers.readers.recording import Frame, LidarFacts, ReadError, ReadOptions, Sensor, Sweep

_IMAGES: Final = frozenset({".jpg", ".jpeg", ".png", ".webp"})
_CLOUDS: Final = frozenset({".pcd"})


class FolderRecording:
    """PCD files (ascii, binary, compressed) and images (JPEG, PNG, WebP: byte for byte) with their times.

    Raises:
        ReadError: ``folder_empty``, ``folder_refused``, ``recording_truncated``, ``files_without_times``,
            ``timestamps_incomplete``, ``timestamps_malformed``.
    """

    format = "folder"

    @staticmethod
    def recognises(path: Path, head: bytes) -> bool:
        """Whether this is a folder, or a file that begins with the header of an uncompressed tar."""
        if path.is_dir():
            return True
        return head[257:262] == b"ustar" or (len(head) >= 512 and _old_tar(head[:512]))

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._tree: FileTree = Folder(path) if path.is_dir() else Tar(path)
        self._options = options
        self._models: dict[str, CloudModel] = {}
        try:
            self._groups = _group(self._tree.paths)
            if not self._groups:
                raise ReadError(
                    "folder_empty",
                    f"{path.name} holds no PCD files and no images.",
                    "Put .pcd files and .jpg, .png or .webp images into it, one subfolder per sensor or all in one.",
                )
            tables = [p for p in self._tree.paths if PurePosixPath(p).name == CSV_NAME]
            everything = [p for paths in self._groups.values() for p in paths]
            self._times: FileTimes = stamp_files(everything, {t: self._tree.read(t) for t in tables})
        except BaseException:
            self._tree.close()
            raise
        for paths in self._groups.values():
            paths.sort(key=lambda p: (self._times.stamps_ns[p], p))
        self._sensors = [
            Sensor(kind, name, "", len(paths), {"times_from": self._times.source})
            for (kind, name), paths in sorted(self._groups.items())
        ]

    @property
    def sensors(self) -> Sequence[Sensor]:
        """One sensor per subfolder and kind, cameras first."""
        return self._sensors

    @property
    def other_topics(self) -> Sequence[str]:
        """Nothing: files of other kinds are not looked at."""
        return ()

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        return [*self._times.warnings, *(said for model in self._models.values() for said in model.warnings())]

    @property
    def share_read(self) -> float | None:
        """None: the number of messages is known beforehand."""
        return None

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What was learned of a LiDAR from files spread over the folder."""
        return self._model(sensor).facts

    def _model(self, sensor: Sensor) -> CloudModel:
        if sensor.name not in self._models:
            options = self._options
            period: int | None = None
            stamps = np.array([self._times.stamps_ns[p] for p in self._paths(sensor)], np.int64)
            if self._times.source == "index":
                # Made-up times say nothing about when, within a sweep, a point was measured.
                options = replace(options, point_times="stamp_only")
            elif len(stamps) > 2:
                period = int(np.median(np.diff(stamps)))
            self._models[sensor.name] = learn_clouds(self._samples(sensor), period, options, sensor.name)
        return self._models[sensor.name]

    def _samples(self, sensor: Sensor) -> Iterator[tuple[int, Columns]]:
        paths = self._paths(sensor)
        numbers: list[int] = np.unique(np.linspace(0, len(paths) - 1, min(SAMPLES, len(paths))).astype(int)).tolist()
        for number in numbers:
            yield self._times.stamps_ns[paths[number]], read_pcd(self._tree.read(paths[number]), paths[number])

    def _paths(self, sensor: Sensor) -> list[str]:
        return self._groups[(sensor.kind, sensor.name)]

    def sweeps(self, sensor: Sensor) -> Iterator[Sweep]:
        """The sweeps of one LiDAR in the order of their stamps."""
        model = self._model(sensor)
        for path in self._paths(sensor):
            yield model.sweep(self._times.stamps_ns[path], read_pcd(self._tree.read(path), path))

    def frames(self, sensor: Sensor) -> Iterator[Frame]:
        """The frames of one camera in the order of their stamps."""
        for path in self._paths(sensor):
            data = self._tree.read(path)
            header = read_image_header(data, path)
            yield Frame(self._times.stamps_ns[path], data, header.media_type, header.width, header.height)

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, merged by stamp."""

        def of(sensor: Sensor) -> Iterator[tuple[Sensor, Sweep | Frame]]:
            items: Iterator[Sweep | Frame] = self.sweeps(sensor) if sensor.kind == "lidar" else self.frames(sensor)
            return ((sensor, item) for item in items)

        return heapq.merge(*(of(sensor) for sensor in sensors), key=lambda pair: pair[1].stamp_ns)

    def close(self) -> None:
        """Close the tar, if it is one."""
        self._tree.close()


def _old_tar(block: bytes) -> bool:
    try:
        tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
    except tarfile.HeaderError:
        return False
    return True


def _group(paths: Sequence[str]) -> dict[tuple[Literal["lidar", "camera"], str], list[str]]:
    """Paths by sensor. Files of one kind in one folder are one sensor, unless their names before the number differ
    and each such name counts several files (``left_1.png``, ``right_1.png``).
    """
    folders: dict[tuple[Literal["lidar", "camera"], str], dict[str, list[str]]] = {}
    for path in paths:
        suffix = PurePosixPath(path).suffix.lower()
        if suffix in _IMAGES or suffix in _CLOUDS:
            kind: Literal["lidar", "camera"] = "camera" if suffix in _IMAGES else "lidar"
            folder = PurePosixPath(path).parent.as_posix()
            folders.setdefault((kind, folder), {}).setdefault(stem_and_number(path)[0], []).append(path)
    groups: dict[tuple[Literal["lidar", "camera"], str], list[str]] = {}
    for (kind, folder), stems in folders.items():
        plain = folder if folder != "." else ("images" if kind == "camera" else "clouds")
        if len(stems) > 1 and all(stem and len(files) > 1 for stem, files in stems.items()):
            for stem, files in stems.items():
                name = stem.strip("_-. ") or plain
                groups.setdefault((kind, name if folder == "." else f"{folder}/{name}"), []).extend(files)
        else:
            groups[(kind, plain)] = [path for files in stems.values() for path in files]
    return groups
