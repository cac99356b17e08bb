"""Sensors whose every sweep or frame is a file of its own: which files of a tree belong together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Final, Literal

from workers.readers.images.still_images import IMAGE_SUFFIXES
from workers.readers.trees.cloud_files import CLOUD_SUFFIXES
from workers.readers.trees.name_times import number_at_end

Kind = Literal["lidar", "camera"]
KINDS: Final[tuple[Kind, ...]] = ("lidar", "camera")
# Where stamps come from: timestamps.csv, KITTI's timestamps.txt, times in names, or numbers, whose times are made up.
TimesFrom = Literal["csv", "kitti", "names", "index"]
_NUMBER_AT_END: Final = re.compile(r"(\d+(?:\.\d+)?)$")


@dataclass(slots=True)
class Series:
    """The files of one sensor.

    Attributes:
        folder: in which they lie.
        paths: sorted by name; once stamped, by stamp.
        stamps_ns: by path, nanoseconds; empty until :func:`workers.readers.trees.file_times.stamp_series`.
        times_from: where the stamps come from.
    """

    kind: Kind
    name: str
    folder: str
    paths: list[str]
    stamps_ns: dict[str, int] = field(default_factory=dict[str, int])
    times_from: TimesFrom = "names"


def is_sensor_file(path: str) -> bool:
    """Whether a file's suffix is that of a cloud or an image; a CSV's content has to tell."""
    return PurePosixPath(path).suffix.lower() in IMAGE_SUFFIXES | CLOUD_SUFFIXES


def stem_and_number(path: str) -> tuple[str, str]:
    """A file's name split before the number at its end: ``a/pose12.pcd`` gives (``pose``, ``12``)."""
    stem = PurePosixPath(path).name.rpartition(".")[0].removesuffix(".pcd")
    match = _NUMBER_AT_END.search(stem)
    return (stem[: match.start()], match.group(1)) if match else (stem, "")


def stem_and_time(path: str) -> tuple[str, str]:
    """As :func:`stem_and_number`, with a whole date, or seconds and their part, as the number."""
    stem = PurePosixPath(path).name.rpartition(".")[0].removesuffix(".pcd")
    text = number_at_end(stem)
    return stem.removesuffix(text), text


def find_series(paths: Sequence[str]) -> list[Series]:
    """Files by sensor, cameras first. Files of one kind in one folder are one sensor, unless their names before the
    number differ and each such name counts several files (``left_1.png``, ``right_1.png``).
    """
    folders: dict[tuple[Kind, str], dict[str, list[str]]] = {}
    for path in sorted(paths):
        kind: Kind = "camera" if PurePosixPath(path).suffix.lower() in IMAGE_SUFFIXES else "lidar"
        folder = PurePosixPath(path).parent.as_posix()
        folders.setdefault((kind, folder), {}).setdefault(stem_and_time(path)[0], []).append(path)
    series: dict[str, Series] = {}
    for (kind, folder), stems in sorted(folders.items()):
        plain = _plain_name(kind, folder, ("camera", folder) in folders and ("lidar", folder) in folders)
        by_name: dict[str, list[str]] = {}
        is_counted = len(stems) > 1 and all(stem and len(files) > 1 for stem, files in stems.items())
        for stem, files in stems.items():
            name = (stem.strip("_-. ") or plain) if is_counted else ""
            name = plain if not name else name if folder == "." else f"{folder}/{name}"
            by_name.setdefault(name, []).extend(files)
        for name, files in by_name.items():
            unique, number = name, 1
            while unique in series:  # files beside a folder `clouds` have its name, too
                unique, number = f"{name}_{number + 1}", number + 1
            series[unique] = Series(kind, unique, folder, sorted(files))
    return list(series.values())


def _plain_name(kind: Kind, folder: str, both: bool) -> str:
    what = "images" if kind == "camera" else "clouds"
    if folder == ".":
        return what
    return f"{folder}/{what}" if both else folder.removesuffix("/data")  # KITTI's: image_02/data
