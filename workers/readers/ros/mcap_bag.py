"""MCAP files: ROS 1, ROS 2 and Foxglove's own messages.

A file is read from its beginning to its end, chunk by chunk. Its summary only tells which channels there are and
where; where it has none (recording was interrupted, or it was left out), the file is looked through once for that.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Schema
from numpy.typing import NDArray
from rosbags.serde import SerdeError

from workers.readers.damage import damage, damage_proof
from workers.readers.pulse import beat
from workers.readers.recording import ReadError
from workers.readers.ros.mcap_records import (
    FOOTER_BYTES,
    MAGIC,
    MAX_CHUNK_BYTES,
    ChunkPlace,
    Contents,
    RecordError,
    head_of,
    message_of,
    records,
    unpacked_chunk,
)
from workers.readers.ros.ros_types import ros_decoder
from workers.readers.ros.topic_messages import Decoder, Topic

_Item = TypeVar("_Item")
_TIMES: Final = 64
_SUMMARY_BYTES: Final = 64 * 1024**2
_HINT: Final = "Copy or upload the file again; `mcap doctor` says what is wrong, `mcap recover` saves the rest."

_NO_SCHEMA: Final = Schema(id=0, data=b"", encoding="", name="")


class McapBag:
    """One .mcap file.

    Raises:
        ReadError: ``recording_damaged``, ``recording_empty``.
    """

    format = "mcap"

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = path.stat().st_size
        self._position = 0
        self.warnings: list[str] = []
        # Places of messages outside chunks, by channel; found only where the file is looked through.
        self._loose: dict[int, array[int]] = {}
        self._file = path.open("rb")
        try:
            with self.damage():
                self.contents = self._summary() or self._look_through()
            if not self.contents.channels:
                raise ReadError(
                    "recording_empty",
                    f"{path.name} is an MCAP file of {self._size} bytes without any channel.",
                    "Copy or upload the file again; look at what recorded it.",
                )
        except BaseException:
            self._file.close()
            raise

    @contextmanager
    def damage(self) -> Generator[None]:
        """What libraries raise on damaged bytes becomes ``recording_damaged``."""
        kinds = (zstandard.ZstdError, SerdeError, RecordError, McapError)
        with damage(self._path.name, "an MCAP file", _HINT, *kinds):
            yield

    def _summary(self) -> Contents | None:
        """What the summary says; None where there is none, or it does not say where the messages are."""
        if self._size < len(MAGIC) + FOOTER_BYTES:
            return None
        self._file.seek(self._size - FOOTER_BYTES)
        tail = self._file.read(FOOTER_BYTES)
        if tail[-len(MAGIC) :] != MAGIC or tail[0] != Opcode.FOOTER:
            return None
        (start,) = struct.unpack_from("<Q", tail, 9)
        length = self._size - FOOTER_BYTES - start
        if not start or not 0 < length < _SUMMARY_BYTES:
            return None
        self._file.seek(start)
        contents = Contents()
        for kind, body in records(memoryview(self._file.read(length))):
            contents.take(kind, body)
        fits = all(chunk.start + chunk.length <= start for chunk in contents.chunks)
        return contents if contents.channels and contents.chunks and fits else None

    def _look_through(self) -> Contents:
        contents = Contents()
        for place, kind, body in self._records(whole=True):
            if kind == Opcode.CHUNK:
                present: set[int] = set()
                for inner, part in records(unpacked_chunk(body)):
                    if inner in (Opcode.SCHEMA, Opcode.CHANNEL):
                        contents.take(inner, part)
                    elif inner == Opcode.MESSAGE:
                        (channel,) = struct.unpack_from("<H", part)
                        contents.counts[channel] = contents.counts.get(channel, 0) + 1
                        present.add(channel)
                contents.chunks.append(ChunkPlace(place, 9 + len(body), frozenset(present)))
            elif kind == Opcode.MESSAGE:
                (channel,) = struct.unpack_from("<H", body)
                contents.counts[channel] = contents.counts.get(channel, 0) + 1
                self._loose.setdefault(channel, array("q")).append(place)
            elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                contents.take(kind, body)
        contents.counts = {number: contents.counts.get(number, 0) for number in contents.channels}
        return contents

    def _records(self, whole: bool, wanted: frozenset[int] | None = None) -> Iterator[tuple[int, int, memoryview]]:
        """(place, kind, body) of the records of the data section; of chunks without ``wanted`` channels none.

        Args:
            whole: whether a file that ends early is to be spoken of.
        """
        skip = {c.start for c in self._chunks_without(wanted)} if wanted is not None else set[int]()
        place = len(MAGIC)
        self._file.seek(place)
        while True:
            head = head_of(self._file)
            if head is None:
                if whole:
                    self._note_end(place)
                return
            beat()
            kind, size = head
            if kind in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if size > self._size - place - 9:
                if whole:
                    self._note_end(place)
                return
            if kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK) and place not in skip:
                if size > MAX_CHUNK_BYTES:
                    raise RecordError(f"a record claims {size} bytes; at most {MAX_CHUNK_BYTES} are read")
                yield place, kind, memoryview(self._file.read(size))
            place += 9 + size
            self._position = place
            self._file.seek(place)

    def _chunks_without(self, wanted: frozenset[int]) -> Iterator[ChunkPlace]:
        return (c for c in self.contents.chunks if c.channels and c.channels.isdisjoint(wanted))

    def _note_end(self, place: int) -> None:
        self.warnings.append(
            f"{self._path.name} ends without its index, as when recording is interrupted; the messages up to byte "
            f"{place} of {self._size} were read."
        )

    @property
    def topics(self) -> Sequence[Topic]:
        """Topics in the order of the file."""
        found: dict[str, Topic] = {}
        for channel in self.contents.channels.values():
            count = self.contents.counts.get(channel.id)
            known = found.get(channel.topic)
            if known is not None and known.count is not None and count is not None:
                count += known.count
            schema = self.contents.schemas.get(channel.schema_id, _NO_SCHEMA)
            definition = "" if schema.encoding == "protobuf" else schema.data.decode(errors="replace")
            found[channel.topic] = Topic(
                channel.topic, schema.name, channel.message_encoding, definition, schema.encoding, count
            )
        return list(found.values())

    @property
    def share_read(self) -> float:
        """Share of the file that has been read."""
        return min(1.0, self._position / max(1, self._size))

    def decoder(self, topic: Topic) -> Decoder | None:
        """See :class:`Container`."""
        own = topic.type.startswith("foxglove.")  # their classes take 20 ms to load
        decode = import_module("workers.readers.ros.foxglove").foxglove_decoder(topic) if own else ros_decoder(topic)
        return None if decode is None else damage_proof(decode, self.damage)

    def _numbers(self, names: Collection[str]) -> dict[int, str]:
        return {c.id: c.topic for c in self.contents.channels.values() if c.topic in names}

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """See :class:`Container`; within a chunk and from chunk to chunk in the order of the file."""
        numbers = self._numbers(names)
        with self.damage():
            for _, kind, body in self._records(whole=False, wanted=frozenset(numbers)):
                parts = records(unpacked_chunk(body)) if kind == Opcode.CHUNK else ((kind, body),)
                for inner, part in parts:
                    if inner == Opcode.MESSAGE and struct.unpack_from("<H", part)[0] in numbers:
                        number, log_ns, data = message_of(part)
                        yield numbers[number], log_ns, data

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """See :class:`Container`."""
        numbers = self._numbers([name])
        with self.damage():
            loose = sorted(place for number in numbers for place in self._loose.get(number, ()))
            chunks = [c for c in self.contents.chunks if not c.channels or not c.channels.isdisjoint(numbers)]
            yield from self._loose_samples(loose, count)
            yield from self._chunk_samples(chunks, numbers, 0 if loose else count)

    def _loose_samples(self, places: Sequence[int], count: int) -> Iterator[tuple[int, bytes]]:
        for place in _spread(places, count):
            self._file.seek(place)
            head = head_of(self._file)
            if head is not None:
                _, log_ns, data = message_of(memoryview(self._file.read(head[1])))
                yield log_ns, data

    def _chunk_samples(
        self, chunks: Sequence[ChunkPlace], numbers: Collection[int], count: int
    ) -> Iterator[tuple[int, bytes]]:
        """Of chunks spread over the file a few messages each, so many that they are enough altogether."""
        chosen = _spread(chunks, count)
        for number, chunk in enumerate(chosen):
            self._file.seek(chunk.start)
            head = head_of(self._file)
            if head is None or head[0] != Opcode.CHUNK or head[1] > MAX_CHUNK_BYTES:
                raise RecordError(f"there is no chunk at byte {chunk.start}, where the index has one")
            parts = records(unpacked_chunk(memoryview(self._file.read(head[1]))))
            found = (message_of(part) for kind, part in parts if kind == Opcode.MESSAGE)
            ours = ((log_ns, data) for channel, log_ns, data in found if channel in numbers)
            share = (number + 1) * count // len(chosen) - number * count // len(chosen)
            yield from islice(ours, share)

    def times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        first = islice(self.messages([name]), _TIMES)
        return np.fromiter((log_ns for _, log_ns, _ in first), np.int64)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _spread(items: Sequence[_Item], count: int) -> list[_Item]:
    """At most ``count`` of the items, evenly spread, the first and the last among them."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count).tolist()] if count else []
