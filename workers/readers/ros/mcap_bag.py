"""MCAP files: ROS 1, ROS 2 and Foxglove's own messages.

A file is read from its beginning to its end, chunk by chunk. Its summary only tells which channels there are and
where; where it has none (recording was interrupted, or it was left out), the file is looked through once for that.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Schema
from numpy.typing import NDArray
from rosbags.serde import SerdeError

from workers.readers.damage import damage, on_error
from workers.readers.detect import MCAP
from workers.readers.progress import beat
from workers.readers.recording import ReadError
from workers.readers.ros.containers import Container, spread
from workers.readers.ros.mcap_records import (
    FOOTER_BYTES,
    HEAD,
    MAX_CHUNK_BYTES,
    ChunkPlace,
    McapContents,
    RecordError,
    message_of,
    records,
    unpacked_chunk,
)
from workers.readers.ros.topic_messages import BagTopic

_TIMES: Final = 64
_CONTENT: Final = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)
_CHANNEL: Final = struct.Struct("<H")
_SUMMARY_BYTES: Final = 64 * 1024**2
_HINT: Final = "Copy or upload the file again; `mcap doctor` says what is wrong, `mcap recover` saves the rest."

_NO_SCHEMA: Final = Schema(id=0, data=b"", encoding="", name="")


class McapBag(Container):
    """One .mcap file.

    Raises:
        ReadError: ``recording_damaged``, ``recording_empty``.
    """

    format = "mcap"

    def __init__(self, path: Path) -> None:
        self._path = path
        self.warnings = []
        self.size = path.stat().st_size
        self._position = 0
        self._ended = False
        # Places of messages outside chunks, by channel; found only where the file is looked through.
        self._loose: dict[int, array[int]] = {}
        self.file = path.open("rb")
        with on_error(self.file.close):
            with self.damage():
                self.contents = self._summary() or self._look_through()
            if not self.contents.channels:
                raise ReadError(
                    "recording_empty",
                    f"{path.name} is an MCAP file of {self.size} bytes without any channel.",
                    "Copy or upload the file again; look at what recorded it.",
                )
        self.topics = self._topics()

    def damage(self) -> AbstractContextManager[None]:
        """Turn the errors that libraries raise on damaged bytes into ``recording_damaged``."""
        kinds = (zstandard.ZstdError, SerdeError, RecordError, McapError)
        return damage(self._path.name, "an MCAP file", _HINT, *kinds)

    def _summary(self) -> McapContents | None:
        """Return the summary; None if it is missing, damaged, or does not say where messages are."""
        if self.size < len(MCAP) + FOOTER_BYTES:
            return None
        self.file.seek(self.size - FOOTER_BYTES)
        tail = self.file.read(FOOTER_BYTES)
        if tail[-len(MCAP) :] != MCAP or tail[0] != Opcode.FOOTER:
            return None
        start, _, checksum = struct.unpack_from("<QQI", tail, HEAD.size)
        length = self.size - FOOTER_BYTES - start
        if not start or not 0 < length < _SUMMARY_BYTES:
            return None
        self.file.seek(start)
        text = self.file.read(length)
        contents = McapContents()
        try:
            if checksum and zlib.crc32(text + tail[: -len(MCAP) - 4]) != checksum:
                raise RecordError("it does not have its checksum")
            for kind, body in records(memoryview(text)):
                contents.take(kind, body)
            for chunk in contents.chunks:
                fits = chunk.start + chunk.length <= start
                if not fits or self._record_at(chunk.start) != (Opcode.CHUNK, chunk.length - HEAD.size):
                    raise RecordError(f"it names a chunk at byte {chunk.start}, where there is none")
        except (RecordError, McapError, struct.error, ValueError):
            self.warnings.append(f"The index of {self._path.name} is damaged; the file was read through instead.")
            return None
        return contents if contents.channels and contents.chunks else None

    def _record_at(self, offset: int) -> tuple[int, int] | None:
        """Kind and size of the record at a place, where the file has its head; the file stands at its body then."""
        self._position = offset
        self.file.seek(offset)
        head = self.file.read(HEAD.size)
        return HEAD.unpack(head) if len(head) == HEAD.size else None

    def _look_through(self) -> McapContents:
        contents = McapContents()
        for offset, kind, size in self.walk():
            present: set[int] = set()
            for inner, part in self.records(kind, size) if kind in _CONTENT else ():
                if inner == Opcode.MESSAGE:
                    present.add(contents.count(part))
                elif inner in (Opcode.SCHEMA, Opcode.CHANNEL):
                    contents.take(inner, part)
            if kind == Opcode.CHUNK:
                contents.chunks.append(ChunkPlace(offset, HEAD.size + size, frozenset(present)))
            for number in present if kind == Opcode.MESSAGE else ():
                self._loose.setdefault(number, array("q")).append(offset)
        if not self._ended:
            self.warnings.append(
                f"{self._path.name} ends without its index, as when recording is interrupted; the messages up to "
                f"byte {self._position} of {self.size} were read."
            )
        contents.counts = {number: contents.counts.get(number, 0) for number in contents.channels}
        return contents

    def walk(self) -> Iterator[tuple[int, int, int]]:
        """(place, kind, size) of the records of the data section, the file standing at each one's body."""
        offset = len(MCAP)
        self._ended = False
        while (head := self._record_at(offset)) is not None:
            beat()
            kind, size = head
            self._ended = kind in (Opcode.DATA_END, Opcode.FOOTER)
            if self._ended or size > self.size - offset - HEAD.size:
                return
            yield offset, kind, size
            offset += HEAD.size + size

    def body(self, size: int) -> memoryview:
        """The body of the record at which the file stands.

        Raises:
            RecordError: it is larger than is read.
        """
        if size > MAX_CHUNK_BYTES:
            raise RecordError(f"a record claims {size} bytes; at most {MAX_CHUNK_BYTES} are read")
        return memoryview(self.file.read(size))

    def records(self, kind: int, size: int) -> Iterable[tuple[int, memoryview]]:
        """The records of the chunk at which the file stands, or the one record that is no chunk."""
        body = self.body(size)
        return records(unpacked_chunk(body)) if kind == Opcode.CHUNK else ((kind, body),)

    def _topics(self) -> Sequence[BagTopic]:
        by_name: dict[str, BagTopic] = {}
        for channel in self.contents.channels.values():
            count = self.contents.counts.get(channel.id)
            topic_of_name = by_name.get(channel.topic)
            if topic_of_name is not None and topic_of_name.count is not None and count is not None:
                count += topic_of_name.count
            schema = self.contents.schemas.get(channel.schema_id, _NO_SCHEMA)
            definition = "" if schema.encoding == "protobuf" else schema.data.decode(errors="replace")
            by_name[channel.topic] = BagTopic(
                *(channel.topic, schema.name, channel.message_encoding, definition, schema.encoding, count),
                qos=channel.metadata.get("offered_qos_profiles", ""),
                type_hash=channel.metadata.get("topic_type_hash", ""),
            )
        return list(by_name.values())

    @property
    def share_read(self) -> float:
        """Share of the file that has been read."""
        return min(1.0, self._position / max(1, self.size))

    def _numbers(self, names: Collection[str]) -> dict[int, str]:
        return {c.id: c.topic for c in self.contents.channels.values() if c.topic in names}

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """See :class:`Container`; within a chunk and from chunk to chunk in the order of the file."""
        numbers = self._numbers(names)
        # Chunks without these topics; of some, an index does not say which they have.
        skip = {c.start for c in self.contents.chunks if c.channels and c.channels.isdisjoint(numbers)}
        with self.damage():
            for offset, kind, size in self.walk():
                if kind not in (Opcode.CHUNK, Opcode.MESSAGE) or offset in skip:
                    continue
                for inner, part in self.records(kind, size):
                    if inner == Opcode.MESSAGE and struct.unpack_from("<H", part)[0] in numbers:
                        number, log_ns, data = message_of(part)
                        yield numbers[number], log_ns, data

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """See :class:`Container`. Of chunks spread over the file a few messages each; else of messages outside."""
        numbers = self._numbers([name])
        chunks = [c.start for c in self.contents.chunks if not c.channels or not c.channels.isdisjoint(numbers)]
        loose = sorted(offset for number in numbers for offset in self._loose.get(number, ()))
        chosen = spread(loose or chunks, count)
        with self.damage():
            for number, offset in enumerate(chosen):
                head = self._record_at(offset)
                if head is None or head[0] != (Opcode.MESSAGE if loose else Opcode.CHUNK):
                    raise RecordError(f"there is no message at byte {offset} any more")
                parts = [part for kind, part in self.records(*head) if kind == Opcode.MESSAGE]
                ours = [part for part in parts if _CHANNEL.unpack_from(part)[0] in numbers]
                share = (number + 1) * count // len(chosen) - number * count // len(chosen)
                is_end = share == 1 and number == count - 1 > 0
                yield from (message_of(part)[1:] for part in (ours[-1:] if is_end else spread(ours, share)))

    def times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        first = islice(self.messages([name]), _TIMES)
        return np.fromiter((log_ns for _, log_ns, _ in first), np.int64)

    def log_times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`. Chunks without their index are read."""
        numbers = {c.id for c in self.contents.channels.values() if c.topic == name}
        times: list[NDArray[np.int64]] = []
        for _, kind, size in self.walk():
            if kind == Opcode.MESSAGE_INDEX and _CHANNEL.unpack(self.file.read(_CHANNEL.size))[0] in numbers:
                # Channel, bytes of the list, then for each message its time and its place in the chunk.
                entries = self.file.read(size - _CHANNEL.size)[4:]
                times.append(np.frombuffer(entries, "<u8", len(entries) // 8).reshape(-1, 2)[:, 0].astype(np.int64))
        indexed = np.concatenate([np.zeros(0, np.int64), *times])
        if len(indexed) == sum(self.contents.counts.get(number, 0) for number in numbers):
            return indexed
        return np.fromiter((log_ns for _, log_ns, _ in self.messages([name])), np.int64)

    def close(self) -> None:
        """Close the file."""
        self.file.close()
