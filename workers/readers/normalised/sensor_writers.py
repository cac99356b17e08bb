"""The writing side of a normalised recording: one file per sensor, as :mod:`apexcal.documents.sensor_files` says."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.sensor_files import FRAME_ENTRY, LAYOUT, MAGIC, MEDIA_TYPES, SWEEP_ENTRY, TAIL
from workers.readers.clouds.pointcloud2 import empty_cloud
from workers.readers.normalised.packed_sweeps import pack
from workers.readers.output import create
from workers.readers.recording import Frame, LidarFacts, MessageError, Sensor, Sweep

# Pixels of 20 megapixels, 24 bits each, as they are; PNG and JPEG take less. Who looks at a frame is sent it whole.
MAX_FRAME_BYTES: Final = 64 * 1024**2
# What the file has of `LidarFacts`.
FACTS: Final = ("time_source", "stamp_convention", "ring_count", "sweep_ns")


def check_stamp(stamp_ns: int, topic: str) -> None:
    """Refuse a stamp that the times of ROS (int32 seconds since 1970) cannot hold.

    Raises:
        MessageError: ``stamp_out_of_range``.
    """
    if not 0 <= stamp_ns < 2**31 * 1_000_000_000:
        raise MessageError(
            "stamp_out_of_range",
            f"{topic} has the stamp {stamp_ns} ns, which lies before 1970 or after 2038.",
            "Stamps are nanoseconds since 1970, UTC; look at the recorder's clock or at the unit of the stamps.",
        )


def check_item(item: Sweep | Frame, topic: str) -> None:
    """Refuse a sweep or a frame that no file holds.

    Raises:
        MessageError: ``stamp_out_of_range``, ``cloud_empty``, ``image_too_large``.
    """
    check_stamp(item.stamp_ns, topic)
    if isinstance(item, Sweep) and not len(item.xyz):
        raise empty_cloud(f"{topic}: the sweep at {item.stamp_ns / 1e9:.3f} s")
    if isinstance(item, Frame) and len(item.data) > MAX_FRAME_BYTES:
        raise MessageError(
            "image_too_large",
            f"A frame of {topic} takes {len(item.data)} bytes; {MAX_FRAME_BYTES} are the most.",
            "Record the camera's frames smaller, or as JPEG.",
        )


class _SensorWriter:
    """A sensor's file while it is written: its items first, in the order in which they come."""

    def __init__(self, path: Path, sensor: Sensor) -> None:
        self.path = path
        self._sensor = sensor
        self._file = create(path)
        self.lengths: list[int] = []

    def _append(self, data: bytes) -> None:
        self._file.write(data)
        self.lengths.append(len(data))

    def _end(self, facts: Mapping[str, object], entries: Sequence[bytes], entry_bytes: int) -> None:
        facts_at = sum(self.lengths)
        facts = {"kind": self._sensor.kind, "topic": self._sensor.name, "frame_id": self._sensor.frame_id, **facts}
        text = json.dumps(facts).encode()
        self._file.write(text)
        self._file.write(b"".join(entries))
        tail = TAIL.pack(facts_at, facts_at + len(text), len(entries), entry_bytes, LAYOUT, MAGIC)
        self._file.write(tail)
        self._file.close()

    def _offsets(self) -> list[int]:
        return np.concatenate([[0], np.cumsum(self.lengths)])[:-1].astype(int).tolist() if self.lengths else []

    def abandon(self) -> None:
        """Close without finishing; what is on disk is of no use."""
        self._file.close()


class SweepWriter(_SensorWriter):
    """Writes a LiDAR's file, read by :class:`workers.readers.normalised.sensor_files.SweepFile`."""

    def __init__(self, path: Path, sensor: Sensor, facts: LidarFacts) -> None:
        super().__init__(path, sensor)
        self._facts = facts
        self.points: list[int] = []

    def add(self, sweep: Sweep) -> None:
        """Append one sweep that :func:`check_item` passed; stamps need not ascend.

        Raises:
            OverflowError: a point lies more than 8.3 s from its sweep's stamp.
        """
        self._append(pack(sweep, self._facts.ring_count))
        self.points.append(len(sweep.xyz))

    def finish(self, stamps_ns: NDArray[np.int64], order: NDArray[np.int64]) -> None:
        """Write facts and index, and close.

        Args:
            stamps_ns: (N,) of the sweeps in the order in which they were added.
            order: (N,) sorts them.
        """
        offsets = self._offsets()
        rows = [(int(stamps_ns[i]), offsets[i], self.lengths[i], self.points[i]) for i in map(int, order)]
        facts = {name: getattr(self._facts, name) for name in FACTS}
        self._end(facts, [SWEEP_ENTRY.pack(*row) for row in rows], SWEEP_ENTRY.size)


class FrameWriter(_SensorWriter):
    """Writes a camera's file: each image is a byte range of it."""

    def __init__(self, path: Path, sensor: Sensor) -> None:
        super().__init__(path, sensor)
        self.kinds: list[tuple[int, int, str]] = []  # width, height and media type; mostly one object

    def add(self, frame: Frame) -> None:
        """Append one frame that :func:`check_item` passed; stamps need not ascend."""
        self._append(frame.data)
        kind = (frame.width, frame.height, frame.media_type)
        self.kinds.append(self.kinds[-1] if self.kinds and self.kinds[-1] == kind else kind)

    def finish(self, stamps_ns: NDArray[np.int64], order: NDArray[np.int64]) -> None:
        """Write facts and index, and close.

        Args:
            stamps_ns: (N,) of the frames in the order in which they were added.
            order: (M,) the numbers of those that are used, by their stamps.
        """
        offsets = self._offsets()
        entries: list[bytes] = []
        for i in map(int, order):
            width, height, media_type = self.kinds[i]
            span = (int(stamps_ns[i]), offsets[i], self.lengths[i])
            entries.append(FRAME_ENTRY.pack(*span, width, height, MEDIA_TYPES.index(media_type)))
        self._end({}, entries, FRAME_ENTRY.size)
