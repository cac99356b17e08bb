"""The reading side of a normalised LiDAR file: sweeps by index or by range, straight from the MCAP index."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO, Final, Self, cast, get_args

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import ChunkIndex
from numpy.typing import NDArray

from workers.readers.damage import on_error
from workers.readers.mcap_io.records import CHUNK, HEAD, MESSAGE
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
        stamps: list[NDArray[np.int64]] = []
        places: list[NDArray[np.int64]] = []
        chunk_of: list[NDArray[np.int64]] = []
        for number, chunk in enumerate(self._chunks):
            entries = self._message_index(chunk)
            stamps.append(entries[:, 0])
            places.append(entries[:, 1])
            chunk_of.append(np.full(len(entries), number, np.int64))
        none = np.zeros(0, np.int64)
        unordered = np.concatenate([none, *stamps])
        if "stamps_ns" in facts:  # the sensor's clock stepped, as was noticed when all had been written
            unordered = np.array(facts["stamps_ns"].split(), np.int64)
        order = np.argsort(unordered, kind="stable")
        self._stamps: NDArray[np.int64] = unordered[order]
        self._stamps.flags.writeable = False
        self._places: NDArray[np.int64] = np.concatenate([none, *places])[order]
        self._chunk_of: NDArray[np.int64] = np.concatenate([none, *chunk_of])[order]
        self._open_chunk = (-1, b"")
        self._decompressor = zstandard.ZstdDecompressor()

    def _message_index(self, chunk: ChunkIndex) -> NDArray[np.int64]:
        """(M, 2) int64: stamp and offset in the uncompressed chunk of each of its messages."""
        # One channel per file, so one MessageIndex record stands right behind its chunk.
        self._file.seek(chunk.chunk_start_offset + chunk.chunk_length)
        record = self._file.read(chunk.message_index_length)
        (length,) = struct.unpack_from("<I", record, 1 + 8 + 2)
        return np.frombuffer(record, "<i8", length // 8, 1 + 8 + 2 + 4).reshape(-1, 2)

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
        chunk = self._chunk(int(self._chunk_of[index]))
        start = int(self._places[index])
        (length,) = struct.unpack_from("<Q", chunk, start + 1)
        message = memoryview(chunk)[start + HEAD.size + MESSAGE.size : start + HEAD.size + length]
        return replace(decode_points(message, self.time_source), stamp_ns=int(self._stamps[index]))

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

    def _chunk(self, number: int) -> bytes:
        if self._open_chunk[0] != number:
            chunk = self._chunks[number]
            self._file.seek(chunk.chunk_start_offset + HEAD.size + CHUNK.size + len(chunk.compression) + 8)
            data = self._file.read(chunk.compressed_size)
            if len(data) != chunk.compressed_size:
                raise _broken(self.path, f"it ends inside the chunk at byte {chunk.chunk_start_offset}")
            if chunk.compression == "zstd":
                data = self._decompressor.decompress(data, max_output_size=chunk.uncompressed_size)
            self._open_chunk = (number, data)
        return self._open_chunk[1]

    def close(self) -> None:
        """Close the file; afterwards only the index can still be read."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
