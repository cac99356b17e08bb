"""Sensors whose every sweep or frame is a file of its own: clouds and images of a tree, with their times."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Literal

import numpy as np

from workers.readers.clouds.model import SAMPLES, CloudModel, Columns, learn_clouds
from workers.readers.images.still_images import IMAGE_SUFFIXES, image_frame
from workers.readers.recording import Frame, LidarFacts, ReadError, ReadOptions, Recording, Sensor, Sweep
from workers.readers.trees.cloud_files import CLOUD_SUFFIXES, read_cloud
from workers.readers.trees.file_times import KITTI_NAME, TimesFrom, stamp_files, stem_and_number
from workers.readers.trees.file_tree import FileTree, read_file
from workers.readers.trees.kitti import KITTI_ENDS, KITTI_STARTS, KittiSpin

Kind = Literal["lidar", "camera"]


@dataclass(frozen=True, slots=True)
class Group:
    """The files of one sensor.

    Attributes:
        folder: in which they lie.
        paths: sorted.
    """

    kind: Kind
    name: str
    folder: str
    paths: list[str]


def is_sensor_file(path: str) -> bool:
    """Whether a file's suffix is that of a cloud or an image; a CSV's content has to tell."""
    suffix = PurePosixPath(path).suffix.lower()
    return suffix in IMAGE_SUFFIXES or suffix in CLOUD_SUFFIXES


def group_files(paths: Sequence[str]) -> list[Group]:
    """Files by sensor, cameras first. Files of one kind in one folder are one sensor, unless their names before the
    number differ and each such name counts several files (``left_1.png``, ``right_1.png``).
    """
    folders: dict[tuple[Kind, str], dict[str, list[str]]] = {}
    for path in sorted(paths):
        kind: Kind = "camera" if PurePosixPath(path).suffix.lower() in IMAGE_SUFFIXES else "lidar"
        folder = PurePosixPath(path).parent.as_posix()
        folders.setdefault((kind, folder), {}).setdefault(stem_and_number(path)[0], []).append(path)
    groups: list[Group] = []
    for (kind, folder), stems in sorted(folders.items()):
        both = ("camera", folder) in folders and ("lidar", folder) in folders
        plain = _plain_name(kind, folder, both)
        if len(stems) > 1 and all(stem and len(files) > 1 for stem, files in stems.items()):
            by_name: dict[str, list[str]] = {}
            for stem, files in stems.items():
                name = stem.strip("_-. ") or plain
                by_name.setdefault(name if folder == "." else f"{folder}/{name}", []).extend(files)
            groups += [Group(kind, name, folder, sorted(files)) for name, files in by_name.items()]
        else:
            groups.append(Group(kind, plain, folder, sorted(path for files in stems.values() for path in files)))
    return _told_apart(groups)


def _told_apart(groups: Sequence[Group]) -> list[Group]:
    """Groups with names of their own. Files beside a folder `clouds` have its name, too: the later are numbered."""
    named: dict[str, Group] = {}
    for group in groups:
        name, number = group.name, 1
        while name in named:
            number += 1
            name = f"{group.name}_{number}"
        named[name] = replace(group, name=name)
    return list(named.values())


def _plain_name(kind: Kind, folder: str, both: bool) -> str:
    what = "images" if kind == "camera" else "clouds"
    if folder == ".":
        return what
    if both:
        return f"{folder}/{what}"
    return folder.removesuffix("/data")  # KITTI's: image_02/data


class FileSeries(Recording):
    """Clouds (PCD, KITTI's .bin, .npy, .csv) and images of a tree, each a file.

    JPEG, PNG and WebP are handed on byte for byte where a browser shows them as they are.

    Args:
        tree: where the files are; it stays open.
        groups: the sensors.
        tables: content of every ``timestamps.csv`` by its path.
        options: what the owner knows.

    Raises:
        ReadError: ``files_without_times``, ``timestamps_incomplete``, ``timestamps_malformed``.
    """

    format = "folder"

    def __init__(
        self, tree: FileTree, groups: Sequence[Group], tables: Mapping[str, bytes], options: ReadOptions
    ) -> None:
        self._tree = tree
        self._options = options
        self._models: dict[str, CloudModel] = {}
        self._groups = {group.name: group for group in groups}
        known = set(tree.paths)
        self._lines = {group.name: self._kitti_lines(group, known) for group in groups}
        lines = {name: found[KITTI_NAME] for name, found in self._lines.items() if found}
        self._times = stamp_files({group.name: group.paths for group in groups}, tables, lines)
        for group in groups:
            group.paths.sort(key=lambda path: (self._times.stamps_ns[path], path))
        self._spins: dict[str, KittiSpin | None] = {}
        self._sensors = [
            Sensor(group.kind, group.name, "", len(group.paths), self._sensor_notes(group)) for group in groups
        ]

    def _kitti_lines(self, group: Group, known: set[str]) -> dict[str, bytes]:
        """KITTI's tables of times, which stand beside the files or beside their folder ``data``."""
        folder = PurePosixPath(group.folder)
        for place in (folder, folder.parent) if folder.name == "data" else (folder,):
            paths = {name: (place / name).as_posix() for name in (KITTI_NAME, KITTI_STARTS, KITTI_ENDS)}
            if paths[KITTI_NAME] in known:
                return {name: read_file(self._tree, path) for name, path in paths.items() if path in known}
        return {}

    def _spin(self, group: Group) -> KittiSpin | None:
        if self._times.sources[group.name] != "kitti" or self._options.point_times != "auto":
            return None
        stamps = {path: self._times.stamps_ns[path] for path in group.paths}
        turn_ns = self._period(group) if self._options.rate_hz is None else round(1e9 / self._options.rate_hz)
        cloud = self._cloud(group.paths[0])
        if any(axis not in cloud for axis in "xyz"):  # said when the cloud is read
            return None
        xyz = np.stack([cloud[axis] for axis in "xyz"], 1).astype(np.float32)
        return KittiSpin.of(self._lines[group.name], stamps, turn_ns, xyz[np.isfinite(xyz).all(1)])

    def _period(self, group: Group) -> int | None:
        """The usual time from one sweep to the next."""
        stamps = np.array([self._times.stamps_ns[path] for path in group.paths], np.int64)
        return int(np.median(np.diff(stamps))) if len(stamps) > 2 else None

    def _sensor_notes(self, group: Group) -> dict[str, str]:
        """What the first file tells: the fields of a cloud, the size of an image."""
        path = group.paths[0]
        notes = {"times_from": self._times.sources[group.name]}
        try:
            if group.kind == "lidar":
                return notes | {"fields": " ".join(self._cloud(path))}
            frame = self._frame(path)
        except ReadError:  # raised again if this sensor is the one that is read
            return notes
        return notes | {"width": str(frame.width), "height": str(frame.height)}

    @property
    def sensors(self) -> Sequence[Sensor]:
        """One sensor per folder and kind."""
        return self._sensors

    @property
    def times_from(self) -> set[TimesFrom]:
        """Where the stamps come from; ``index`` where they are made up."""
        return set(self._times.sources.values())

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        return [*self._times.warnings, *(said for model in self._models.values() for said in model.warnings())]

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What was learned of a LiDAR from files spread over the folder."""
        facts = self._model(sensor).facts
        spin = self._spins.get(sensor.name)
        return facts if spin is None else spin.facts(facts, sensor.name)

    def _model(self, sensor: Sensor) -> CloudModel:
        if sensor.name not in self._models:
            options = self._options
            group = self._groups[sensor.name]
            self._spins[sensor.name] = self._spin(group)
            made_up = self._times.sources[sensor.name] == "index"
            if made_up or self._spins[sensor.name] is not None:
                # Made-up times say nothing about when, within a sweep, a point was measured.
                options = replace(options, point_times="stamp_only")
            period = None if made_up else self._period(group)
            self._models[sensor.name] = learn_clouds(self._samples(sensor), period, options, sensor.name)
        return self._models[sensor.name]

    def _samples(self, sensor: Sensor) -> Iterator[tuple[int, Columns]]:
        paths = self._groups[sensor.name].paths
        numbers: list[int] = np.unique(np.linspace(0, len(paths) - 1, min(SAMPLES, len(paths))).astype(int)).tolist()
        for number in numbers:
            yield self._times.stamps_ns[paths[number]], self._cloud(paths[number])

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen sensors, merged by stamp."""
        return heapq.merge(*map(self._messages, sensors), key=lambda pair: pair[1].stamp_ns)

    def _messages(self, sensor: Sensor) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        paths = self._groups[sensor.name].paths
        if sensor.kind == "camera":
            yield from ((sensor, self._frame(path)) for path in paths)
            return
        model, spin = self._model(sensor), self._spins.get(sensor.name)
        for path in paths:
            sweep = model.sweep(self._times.stamps_ns[path], self._cloud(path))
            yield sensor, sweep if spin is None else spin.timed(sweep, path)

    def _frame(self, path: str) -> Frame:
        return image_frame(read_file(self._tree, path), self._times.stamps_ns[path], path)

    def _cloud(self, path: str) -> Columns:
        return read_cloud(read_file(self._tree, path), path)
