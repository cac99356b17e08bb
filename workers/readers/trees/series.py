"""Sensors whose every sweep or frame is a file of its own: which files of a tree belong together."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Final, Literal

from workers.readers.images.still_images import IMAGE_SUFFIXES
from workers.readers.trees.cloud_files import CLOUD_SUFFIXES
from workers.readers.trees.name_times import SessionNumber, number_at_end, session_numbers

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
        texts: by path, the time or the number with which a name ends.
        stamps_ns: by path, nanoseconds; empty until :func:`workers.readers.trees.file_times.stamp_series`.
        times_from: where the stamps come from.
    """

    kind: Kind
    name: str
    folder: str
    paths: list[str]
    texts: dict[str, str] = field(default_factory=dict[str, str])
    stamps_ns: dict[str, int] = field(default_factory=dict[str, int])
    times_from: TimesFrom = "names"

    def __post_init__(self) -> None:
        """Read the end of each name by itself, where nobody has looked at all of them."""
        self.texts = self.texts or {path: number_at_end(_stem(path)) for path in self.paths}


def is_sensor_file(path: str) -> bool:
    """Whether a file's suffix is that of a cloud or an image; a CSV's content has to tell."""
    return PurePosixPath(path).suffix.lower() in IMAGE_SUFFIXES | CLOUD_SUFFIXES


def stem_and_number(path: str) -> tuple[str, str]:
    """A file's name split before the number at its end: ``a/pose12.pcd`` gives (``pose``, ``12``)."""
    stem = _stem(path)
    match = _NUMBER_AT_END.search(stem)
    return (stem[: match.start()], match.group(1)) if match else (stem, "")


def _stem(path: str) -> str:
    return PurePosixPath(path).name.rpartition(".")[0].removesuffix(".pcd")


def _split_names(folders: Iterable[Sequence[str]]) -> dict[str, tuple[str, str]]:
    """Names of files, folder by folder, split before the time or the number at their end.

    Numbers that count the files of sessions go on from session to session, by the sessions' dates.
    """
    split: dict[str, tuple[str, str]] = {}
    counted: dict[str, SessionNumber] = {}
    for paths in folders:
        numbers = session_numbers([_stem(path) for path in paths])
        for path in paths:
            stem = _stem(path)
            text = number_at_end(stem)
            split[path] = (stem.removesuffix(text), text)
            if stem in numbers:
                counted[path] = numbers[stem]
    dates = sorted({number.date for number in counted.values()})
    width = max((len(number.digits) for number in counted.values()), default=0)
    for path, (name, date, digits) in counted.items():
        split[path] = (name, digits if len(dates) == 1 else f"{dates.index(date)}{digits:0>{width}}")
    return split


def find_series(paths: Sequence[str]) -> list[Series]:
    """Files by sensor, cameras first. Files of one kind in one folder are one sensor, unless their names before the
    number differ and each such name counts several files (``left_1.png``, ``right_1.png``).
    """
    folders: dict[tuple[Kind, str], list[str]] = {}
    for path in sorted(paths):
        kind: Kind = "camera" if PurePosixPath(path).suffix.lower() in IMAGE_SUFFIXES else "lidar"
        folders.setdefault((kind, PurePosixPath(path).parent.as_posix()), []).append(path)
    split = _split_names(folders.values())
    series: dict[str, Series] = {}
    for (kind, folder), files_of_kind in sorted(folders.items()):
        stems: dict[str, list[str]] = {}
        for path in files_of_kind:
            stems.setdefault(split[path][0], []).append(path)
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
            texts = {path: split[path][1] for path in files}
            series[unique] = Series(kind, unique, folder, sorted(files), texts)
    return list(series.values())


def _plain_name(kind: Kind, folder: str, both: bool) -> str:
    what = "images" if kind == "camera" else "clouds"
    if folder == ".":
        return what
    return f"{folder}/{what}" if both else folder.removesuffix("/data")  # KITTI's: image_02/data
