"""The reading side of a normalised recording: a sensor's sweeps or frames by number, and the index of its file."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, Self, cast, get_args

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import StampConvention
from apexcal.documents.sensor_files import FRAME_ENTRY, LAYOUT, MAGIC, MEDIA_TYPES, SWEEP_ENTRY, TAIL
from workers.readers.damage import on_error
from workers.readers.normalised.packed_sweeps import unpacked
from workers.readers.recording import ReadError, Sweep, TimeSource

_PLACE: Final = [("stamp_ns", "<i8"), ("offset", "<i8"), ("length", "<u4")]
_ENTRIES: Final = {
    "lidar": np.dtype([*_PLACE, ("points", "<u4")]),
    "camera": np.dtype([*_PLACE, ("width", "<u4"), ("height", "<u4"), ("media_type", "<u4")]),
}
assert [each.itemsize for each in _ENTRIES.values()] == [SWEEP_ENTRY.size, FRAME_ENTRY.size]
_MOST_FACTS_BYTES: Final = 1024**2
# No message that is read holds more: 160 MB of 12 bytes a point.
_MOST_POINTS: Final = 2**24


class SensorFile:
    """A sensor's file of a normalised recording; its sweeps or frames are numbered 0 to len - 1 by their stamps.

    It reads a file that a process wrote which had a stranger's bytes: nothing in it is believed unseen. Not safe to
    share between threads; open one per thread.

    Attributes:
        frame_id: the sensor's coordinate frame, as its recording said.
        topic: its topic or folder in the original recording.
        entries: (N,) structured: ``stamp_ns``, ``offset`` and ``length``; of a LiDAR ``points``, of a camera
            ``width``, ``height`` and ``media_type`` (its number in ``MEDIA_TYPES``). Read-only.

    Raises:
        ReadError: ``not_normalised``.
    """

    kind: Literal["lidar", "camera"]

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file: BinaryIO = self.path.open("rb")
        with on_error(self._file.close):
            try:
                self._read()
            except (struct.error, KeyError, TypeError, ValueError, OSError) as error:
                raise self._broken(str(error) or type(error).__name__) from error

    def _read(self) -> None:
        size = self._file.seek(0, 2)
        facts_at, index_at, count, entry_bytes, layout, magic = TAIL.unpack(self._range(size - TAIL.size, TAIL.size))
        if (magic, layout) != (MAGIC, LAYOUT):
            raise ValueError(f"it does not end as layout {LAYOUT} does")
        layout_of_entry = _ENTRIES[self.kind]
        length = layout_of_entry.itemsize * count
        if not 0 <= facts_at <= index_at <= facts_at + _MOST_FACTS_BYTES or index_at + length + TAIL.size != size:
            raise ValueError("its parts do not fit into each other")
        facts: dict[str, Any] = json.loads(self._range(facts_at, index_at - facts_at))
        if facts["kind"] != self.kind or entry_bytes != layout_of_entry.itemsize:
            raise ValueError(f"it is of a {facts['kind']!r}, not of a {self.kind}")
        self.topic, self.frame_id = str(facts["topic"]), str(facts["frame_id"])
        self.entries = np.frombuffer(self._range(index_at, length), layout_of_entry)
        offset, ends = self.entries["offset"], self.entries["offset"] + self.entries["length"]
        is_inside = count == 0 or (offset.min() >= 0 and max(offset.max(), ends.max()) <= facts_at)
        if not is_inside or np.any(np.diff(self.entries["stamp_ns"]) < 0):
            raise ValueError("its index names bytes that are not there, or stamps in no order")
        self._take(facts)

    def _take(self, facts: dict[str, Any]) -> None:
        """Learn what a kind of sensor has besides."""

    def _range(self, offset: int, length: int) -> bytes:
        self._file.seek(offset)
        data = self._file.read(length)
        if len(data) != length:
            raise ValueError(f"it ends before byte {offset + length}")
        return data

    def _broken(self, why: str) -> ReadError:
        return ReadError(
            "not_normalised",
            f"{self.path.name} is no file of a normalised recording: {why}.",
            "Upload the original recording again.",
        )

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64, UTC nanoseconds, ascending, read-only."""
        return self.entries["stamp_ns"]

    def data(self, index: int) -> bytes:
        """The bytes of one sweep or image.

        Raises:
            IndexError: there is none of that number.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"{index} of {len(self)}")
        return self._range(int(self.entries["offset"][index]), int(self.entries["length"][index]))

    def close(self) -> None:
        """Close the file; afterwards only the index can still be read."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class SweepFile(SensorFile):
    """A LiDAR's file.

    Attributes:
        time_source: where ``offset_ns`` of the sweeps comes from.
        stamp_convention: what a sweep's stamp means.
        ring_count: number of rings of the sensor; rings are 0 to ring_count - 1.
        sweep_ns: duration of one turn, nanoseconds, 0 where unknown.
    """

    kind = "lidar"

    def _take(self, facts: dict[str, Any]) -> None:
        if facts["time_source"] not in get_args(TimeSource):
            raise ValueError(f"unknown time source {facts['time_source']!r}")
        self.time_source: TimeSource = cast(TimeSource, facts["time_source"])
        self.stamp_convention: StampConvention = cast(StampConvention, facts["stamp_convention"])
        if self.entries["points"].max(initial=0) > _MOST_POINTS:
            raise ValueError(f"a sweep claims more than {_MOST_POINTS} points")
        self.ring_count, self.sweep_ns = int(facts["ring_count"]), int(facts["sweep_ns"])
        # A view of its field, which lies apart in memory, would be searched slowly.
        self._stamps: NDArray[np.int64] = self.entries["stamp_ns"].astype(np.int64)
        self._stamps.flags.writeable = False

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64, UTC nanoseconds, ascending, read-only."""
        return self._stamps

    def sweep(self, index: int) -> Sweep:
        """Sweep ``index`` in stamp order, its points ordered by ring.

        Raises:
            IndexError: no such sweep.
            ReadError: ``not_normalised``.
        """
        data, points = self.data(index), int(self.entries["points"][index])
        try:
            return unpacked(data, points, int(self._stamps[index]), self.time_source)
        except ValueError as error:
            raise self._broken(f"sweep {index}: {error}") from error

    def nearest(self, stamp_ns: int) -> int:
        """Number of the sweep whose stamp is nearest to a moment, the earlier of two.

        Raises:
            IndexError: the file holds no sweeps.
        """
        if not len(self):
            raise IndexError("there are no sweeps")
        after = int(np.searchsorted(self._stamps, stamp_ns))
        if after == 0 or after == len(self):
            return min(after, len(self) - 1)
        return after - 1 if stamp_ns - self._stamps[after - 1] <= self._stamps[after] - stamp_ns else after

    def sweeps(self, first: int = 0, last: int | None = None) -> Iterator[Sweep]:
        """Sweeps ``first`` up to, not including, ``last`` (None: to the end)."""
        for index in range(first, len(self) if last is None else last):
            yield self.sweep(index)


class FrameFile(SensorFile):
    """A camera's file."""

    kind = "camera"

    def _take(self, facts: dict[str, Any]) -> None:
        if np.any(self.entries["media_type"] >= len(MEDIA_TYPES)):
            raise ValueError("an image of an unknown type")

    def media_type(self, index: int) -> str:
        """Return the media type of an encoded image."""
        return MEDIA_TYPES[int(self.entries["media_type"][index])]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Each frame's entry by the names of its columns, with its number as ``index``."""
        names = self.entries.dtype.names or ()
        for index, values in enumerate(self.entries.tolist()):
            yield {"index": index} | dict(zip(names, values, strict=True)) | {"media_type": self.media_type(index)}
