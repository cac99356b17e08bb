"""The reading side of a normalised LiDAR file: sweeps by index or by range, straight from the MCAP index."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, Final, Self, cast, get_args

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex, Message, MessageIndex
from mcap.stream_reader import breakup_chunk
from numpy.typing import NDArray

from workers.readers.damage import on_error
from workers.readers.mcap_io.records import HEAD
from workers.readers.normalised.cdr import decode_points
from workers.readers.recording import ReadError, StampConvention, Sweep, TimeSource
from workers.readers.ros.ros_types import CLOUD

METADATA_NAME: Final = "apexcal"
# What the file keeps of `LidarFacts`.
FACTS: Final = ("time_source", "stamp_convention", "ring_count", "sweep_ns")


def _broken(path: Path, why: str) -> ReadError:
    return ReadError(
        "not_normalised",
        f"{path.name} is not a LiDAR file of a normalised recording: {why}.",
        "Ingest the original recording again.",
    )


class LidarFile:
    """A normalised ``lidar.mcap``, its sweeps ordered by stamp.

    Sweeps are numbered 0 to len - 1 in the order of their stamps, the same numbers as in the manifest's table.
    Not safe to share between threads; open one per thread.

    Attributes:
        frame_id: the LiDAR's coordinate frame, as its file said.
        topic: its topic or folder in the original recording.
        time_source: where ``offset_ns`` of the sweeps comes from.
        stamp_convention: what a sweep's stamp means.
        ring_count: number of rings of the sensor; rings are 0 to ring_count - 1.
        sweep_ns: duration of one turn, nanoseconds, 0 where unknown.

    Raises:
        ReadError: ``not_normalised``.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file: BinaryIO = self.path.open("rb")
        with on_error(self._file.close):
            try:
                self._read_index()
            except (McapError, struct.error, KeyError, UnicodeDecodeError, OSError, ValueError) as error:
                raise _broken(self.path, str(error) or type(error).__name__) from error

    def _read_index(self) -> None:
        reader = SeekingReader(self._file)
        summary = reader.get_summary()
        if summary is None:
            raise _broken(self.path, "it has no summary")
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        if METADATA_NAME not in metadata:
            raise _broken(self.path, "apexcal's metadata record is missing")
        facts = metadata[METADATA_NAME]
        if [schema.name for schema in summary.schemas.values()] != [CLOUD]:
            raise _broken(self.path, f"it should hold {CLOUD} and nothing else")
        self.frame_id = facts["frame_id"]
        self.topic = facts["topic"]
        if facts["time_source"] not in get_args(TimeSource):
            raise _broken(self.path, f"unknown time source {facts['time_source']!r}")
        self.time_source: TimeSource = cast(TimeSource, facts["time_source"])
        self.stamp_convention: StampConvention = cast(StampConvention, facts["stamp_convention"])
        self.ring_count = int(facts["ring_count"])
        self.sweep_ns = int(facts["sweep_ns"])
        self._chunks: list[ChunkIndex] = sorted(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
        # One channel per file, so one index of messages stands right behind its chunk. Of each message, in the order
        # of their stamps: (stamp, number of its chunk, number in it).
        messages: list[tuple[int, int, int]] = []
        for number, chunk in enumerate(self._chunks):
            self._file.seek(chunk.chunk_start_offset + chunk.chunk_length + HEAD.size)
            index = MessageIndex.read(ReadDataStream(self._file))
            messages += ((stamp_ns, number, place) for place, (stamp_ns, _) in enumerate(index.records))
        messages.sort(key=itemgetter(0))
        table = np.array(messages, np.int64).reshape(-1, 3)
        table.flags.writeable = False
        self._stamps, self._places = table[:, 0], table[:, 1:]
        self._open_chunk = -1
        self._messages: list[bytes] = []  # of the open chunk

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,) int64, UTC nanoseconds, ascending, read-only."""
        return self._stamps

    def sweep(self, index: int) -> Sweep:
        """Sweep ``index`` in stamp order.

        Raises:
            IndexError: no such sweep.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"sweep {index} of {len(self)}")
        number, place = map(int, self._places[index])
        if self._open_chunk != number:
            chunk = self._chunks[number]
            self._file.seek(chunk.chunk_start_offset + HEAD.size)
            try:
                records = breakup_chunk(Chunk.read(ReadDataStream(self._file)))
            except (McapError, zstandard.ZstdError) as error:
                raise _broken(self.path, f"it ends inside the chunk at byte {chunk.chunk_start_offset}") from error
            self._open_chunk, self._messages = number, [each.data for each in records if isinstance(each, Message)]
        return decode_points(self._messages[place], self.time_source)

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

    def close(self) -> None:
        """Close the file; afterwards only the index can still be read."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
