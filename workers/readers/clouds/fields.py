"""The meaning of a cloud's columns, by the names that drivers, converters and file formats give them.

Names are compared without case, separators and CloudCompare's ``scalar_``. What a column holds decides in the end: a
ring keeps its elevation, and times span a sweep. A name here only says what to try.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import MessageError

Columns = Mapping[str, NDArray[np.generic]]

# VeloView and ParaView write Points_m_XYZ:0, spreadsheets x_m or "X [m]".
_AXES: Final = tuple(
    (
        *(axis, f"{axis}m", f"{axis}coord", f"{axis}coordinate", f"points{index}"),
        *(f"pointsmxyz{index}", f"pos{axis}", f"position{axis}", f"coord{axis}", f"point{axis}"),
    )
    for index, axis in enumerate("xyz")
)
_RING: Final = tuple(
    base + ending
    for base in ("ring", "channel", "laser", "line", "layer", "beam", "scanline", "row", "emitter")
    for ending in ("", "id", "index", "idx", "number", "num", "no", "nr", "s")
)
_INTENSITY: Final = (
    *("intensity", "i", "intensities", "reflectivity", "reflectance", "refl", "signal", "signalphotons", "remission"),
    *("remissions", "amplitude", "echointensity", "strength", "rssi", "echowidth", "pulsewidth"),
)
_TIME: Final = (
    *("time", "t", "timestamp", "offsettime", "timeoffset", "ts", "stamp", "pointtimeoffset", "pointtime"),
    *("pointtimestamp", "reltime", "relativetime", "relativetimestamp", "timerelative", "deltatime", "toffset"),
    *("dt", "deltat", "offset", "adjustedtime", "firingtime", "measurementtime", "gpstime", "utctime", "unixtime"),
)
# Endings that state a unit, in nanoseconds. Those of whole seconds may stand beside a part of a second.
# An s alone may be a plural.
_SECONDS: Final[Mapping[str, float | None]] = {**dict.fromkeys(("seconds", "secs", "sec"), 1e9), "s": None}
_PARTS: Final = {
    **dict.fromkeys(("nanoseconds", "nanosecs", "nanosec", "nsecs", "nsec", "ns"), 1.0),
    **dict.fromkeys(("microseconds", "microsecs", "microsec", "usecs", "usec", "us"), 1e3),
    **dict.fromkeys(("milliseconds", "millisecs", "millisec", "msecs", "msec", "ms"), 1e6),
}
_MOST_LISTED: Final = 20
_MOST_TRIED: Final = 8  # columns of one meaning


@dataclass(frozen=True, slots=True)
class TimeField:
    """Columns that hold the moment of a point: one, or whole seconds and a part of a second.

    ``unit_ns``: nanoseconds in one unit, of the part where there are two columns; None: the name does not say it.
    """

    names: tuple[str, ...]
    unit_ns: float | None

    def values(self, columns: Columns) -> NDArray[np.generic]:
        """(N,) times as the file has them; (N,) int64 nanoseconds of two columns."""
        if len(self.names) == 1:
            return columns[self.names[0]]
        seconds, part = (columns[name] for name in self.names)
        whole = _whole(seconds.astype(np.float64)) * 1_000_000_000
        return whole + _whole(part.astype(np.float64) * (self.unit_ns or 1.0))


def _whole(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N,) int64 of numbers; 0 of what is none, and of seconds past the year 2242."""
    return np.where(np.abs(values) < 2.0**33, values, 0.0).astype(np.int64)


@dataclass(frozen=True, slots=True)
class CloudFields:
    """The column of each meaning in a file.

    Attributes:
        where: names the LiDAR in messages.
        xyz: the columns of x, y and z.
        rings: columns that may hold the ring, the likeliest first.
        intensities, times: likewise.
        others: columns that are none of these.
    """

    where: str
    xyz: tuple[str, str, str]
    rings: tuple[str, ...]
    intensities: tuple[str, ...]
    times: tuple[TimeField, ...]
    others: tuple[str, ...]

    @classmethod
    def of(cls, columns: Columns, where: str) -> CloudFields:
        """Choose among a file's columns; those of several values a point are none of these.

        Raises:
            MessageError: ``cloud_without_xyz``.
        """
        plain = {name: _plain(name) for name, values in columns.items() if values.ndim == 1}
        axes = tuple(next(iter(_named(plain, names)), None) for names in _AXES)
        missing = [axis for axis, name in zip("xyz", axes, strict=True) if name is None]
        if missing:
            raise MessageError(
                "cloud_without_xyz",
                f"{where} has no {' and no '.join(missing)}; its fields are: {listed(list(columns)) or 'none'}.",
                "Record the LiDAR's point cloud topic, or choose it when ingesting. If coordinates have other names, "
                "call them x, y and z, metres.",
            )
        x, y, z = (str(name) for name in axes)
        rings, intensities = _named(plain, _RING)[:_MOST_TRIED], _named(plain, _INTENSITY)[:_MOST_TRIED]
        times = _times(plain)[:_MOST_TRIED]
        taken = {x, y, z, *rings, *intensities, *(name for time in times for name in time.names)}
        return cls(where, (x, y, z), rings, intensities, times, tuple(name for name in columns if name not in taken))

    def check(self, stamp_ns: int, columns: Columns, needed: Sequence[str]) -> None:
        """Hold a cloud against what most have.

        Raises:
            MessageError: ``cloud_fields_differ``.
        """
        missing = [name for name in needed if name not in columns]
        if missing:
            raise MessageError(
                "cloud_fields_differ",
                f"{self.where}: the cloud at {stamp_ns / 1e9:.3f} s has no {' and no '.join(missing)}, which the "
                "others have.",
                "Two sensors may share this topic or folder, or the file is damaged: record them apart, or copy it "
                "again.",
            )

    @property
    def candidates(self) -> tuple[str, ...]:
        """The columns that may have a meaning, beside coordinates."""
        return (*self.rings, *self.intensities, *(name for time in self.times for name in time.names))

    @property
    def unused(self) -> str:
        """A sentence on columns whose names are not known, where one of them may be what is missing; or empty."""
        missing = {"ring": self.rings, "time": self.times, "intensity": self.intensities}
        lacking = [meaning for meaning, names in missing.items() if not names]
        if not lacking or not self.others:
            return ""
        return (
            f"These fields were not used: {listed(self.others)}. If one of them is the {' or the '.join(lacking)}, "
            f"call it {' or '.join(lacking)}."
        )


def listed(names: Sequence[str]) -> str:
    """The names in a row, the first of very many."""
    more = [f"and {len(names) - _MOST_LISTED} more"] if len(names) > _MOST_LISTED else []
    return ", ".join([*names[:_MOST_LISTED], *more])


def meanings(names: Sequence[str]) -> set[str]:
    """Return the meanings (``x``, ``y``, ``z``, ``ring``, ``intensity``, ``time``) that such columns may have."""
    plain = {name: _plain(name) for name in names}
    tables = {**dict(zip("xyz", _AXES, strict=True)), "ring": _RING, "intensity": _INTENSITY}
    of_one_column = {meaning for meaning, words in tables.items() if _named(plain, words)}
    return of_one_column | ({"time"} if _times(plain) else set[str]())


def is_point_table(names: Sequence[str]) -> bool:
    """Whether a table with columns of these names has x, y and z."""
    return {"x", "y", "z"} <= meanings(names)


def _plain(name: str) -> str:
    """A name's letters and digits in small letters, without CloudCompare's ``scalar_``."""
    return re.sub(r"[\W_]+", "", name.lower()).removeprefix("scalar")


def _named(plain: Mapping[str, str], names: Sequence[str]) -> tuple[str, ...]:
    """The columns of these names, by the names' order."""
    rank = {name: index for index, name in enumerate(names)}
    return tuple(sorted((name for name, word in plain.items() if word in rank), key=lambda name: rank[plain[name]]))


def _times(plain: Mapping[str, str]) -> tuple[TimeField, ...]:
    """Columns of times: by a known name, with a unit behind it or without; or whole seconds beside their part."""
    ranked: list[tuple[int, TimeField]] = []
    for name, word in plain.items():
        for ending, unit_ns in {"": None, **_PARTS, **_SECONDS}.items():
            if word.endswith(ending) and word.removesuffix(ending) in _TIME:
                ranked.append((_TIME.index(word.removesuffix(ending)), TimeField((name,), unit_ns)))
                break
    by_word = {word: name for name, word in plain.items()}
    pairs = [pair for name, word in plain.items() if (pair := _with_part(name, word, by_word)) is not None]
    inside = {name for pair in pairs for name in pair.names}
    single = [time for _, time in sorted(ranked, key=lambda each: each[0]) if time.names[0] not in inside]
    return (*single, *pairs)


def _with_part(name: str, word: str, by_word: Mapping[str, str]) -> TimeField | None:
    """Whole seconds with their part, as ``lidar_sec`` and ``lidar_nsec``."""
    for ending in _SECONDS:
        stem = word.removesuffix(ending)
        if stem == word or (ending == "s" and stem not in _TIME):
            continue
        for part, unit_ns in _PARTS.items():
            if stem + part in by_word:
                return TimeField((name, by_word[stem + part]), unit_ns)
    return None
