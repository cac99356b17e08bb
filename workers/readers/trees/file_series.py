"""One sensor of a tree whose every sweep or frame is a file, as a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property, partial
from pathlib import PurePosixPath
from typing import Final

import numpy as np

from apexcal.documents.readings import ReadOptions
from workers.readers.clouds.fields import Columns
from workers.readers.clouds.model import SAMPLES, CloudModel, learn_clouds
from workers.readers.images.still_images import image_frame
from workers.readers.omissions import Omissions, readable
from workers.readers.recording import Frame, LidarFacts, ReadError, Recording, Sensor, Sweep
from workers.readers.trees.cloud_files import UNNAMED, column_names, read_cloud
from workers.readers.trees.file_tree import FileTree, read_file
from workers.readers.trees.series import Series

_LOOKED_INTO: Final = 5  # files whose content tells what their columns are


class FileSeries(Recording):
    """Clouds (PCD, PLY, KITTI's .bin, .npy, .csv) or images of a tree, each a file.

    JPEG, PNG and WebP are handed on byte for byte where a browser shows them as they are.

    Args:
        tree: where the files are; it stays open.
        series: the files, stamped.
        looks_ahead: stamps are the moments at which the LiDAR looks ahead, as KITTI's are.
        options: what the owner knows.
    """

    format = "folder"

    def __init__(self, tree: FileTree, series: Series, options: ReadOptions, *, looks_ahead: bool) -> None:
        self._tree, self._series, self._options, self._looks_ahead = tree, series, options, looks_ahead
        self._omissions = Omissions()
        self.sensors = [Sensor(series.kind, series.name, "", len(series.paths), self._notes())]

    def _notes(self) -> dict[str, str]:
        """Return the facts that the first file tells: the fields of a cloud, the size of an image."""
        notes: dict[str, str] = {"times_from": self._series.times_from}
        try:
            if self._series.kind == "lidar":
                clouds = readable(partial(self._cloud, path) for path in self._spread())
                return notes | {"fields": " ".join(next(clouds))}
            frame = next(readable(partial(self._frame, path) for path in self._spread()))
        except ReadError:  # raised again if this sensor is the one that is read
            return notes
        return notes | {"width": str(frame.width), "height": str(frame.height)}

    def _spread(self) -> list[str]:
        """Files spread over the folder, the first and the last among them."""
        paths = self._series.paths
        return [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, min(SAMPLES, len(paths))).astype(int))]

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        return self._model.warnings() if "_model" in self.__dict__ else []

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """The facts learned of a LiDAR from files spread over the folder."""
        return self._model.facts

    @cached_property
    def _period(self) -> int | None:
        """The usual time from one sweep to the next."""
        stamps = np.array([self._series.stamps_ns[path] for path in self._series.paths], np.int64)
        return int(np.median(np.diff(stamps))) if len(stamps) > 2 else None

    @cached_property
    def _model(self) -> CloudModel:
        options = self._options
        made_up = self._series.times_from == "index"
        if made_up or self._looks_ahead:
            # Neither says when, within a sweep, a point was measured.
            options = options.model_copy(update={"point_times": "stamp_only"})
        samples = readable(partial(self._stamped_cloud, path) for path in self._spread())
        return learn_clouds(samples, None if made_up else self._period, options, self._series.name)

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """The sweeps or frames by stamp, if the sensor was chosen."""
        self._omissions.clear(sensor.name for sensor in sensors)
        for sensor in sensors:
            for path in self._series.paths:
                with self._omissions.leaving_out(sensor.name, self._series.stamps_ns[path]):
                    yield sensor, self._frame(path) if sensor.kind == "camera" else self._sweep(path)

    @property
    def omissions(self) -> Omissions:
        """Files that cannot be used."""
        return self._omissions

    def _sweep(self, path: str) -> Sweep:
        return self._model.sweep(*self._stamped_cloud(path))

    def _stamped_cloud(self, path: str) -> tuple[int, Columns]:
        return self._series.stamps_ns[path], self._cloud(path)

    def _frame(self, path: str) -> Frame:
        return image_frame(read_file(self._tree, path), self._series.stamps_ns[path], path)

    def _cloud(self, path: str) -> Columns:
        return read_cloud(read_file(self._tree, path), path, self._columns)

    @cached_property
    def _columns(self) -> list[str] | None:
        """Names of columns that the files do not name: one order for all of them."""
        if PurePosixPath(self._series.paths[0]).suffix.lower() not in UNNAMED:
            return None
        with suppress(ReadError):  # said where the file is read
            return column_names({path: read_file(self._tree, path) for path in self._spread()[:_LOOKED_INTO]})
        return None
