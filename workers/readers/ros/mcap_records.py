"""The records of an MCAP file that reading needs, after mcap.dev/spec, and their bounds."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO, Final

from workers.readers.bounded import ExpandsError, decompress_lz4, decompress_zstd

MAGIC: Final = b"\x89MCAP0\r\n"
FOOTER_BYTES: Final = 9 + 20 + len(MAGIC)
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, DATA_END = (
    *(1, 2, 3, 4, 5, 6, 7, 8, 11, 15),
)
# One message is all that a chunk must hold; no sensor's is larger.
MAX_CHUNK_BYTES: Final = 160 * 1024**2
_HEAD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_CHUNK: Final = struct.Struct("<QQQI")


class RecordError(ValueError):
    """Bytes that are no MCAP record."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel with its schema."""

    number: int
    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """Where a chunk stands, and which channels have messages in it (empty: not said)."""

    start: int
    length: int
    channels: frozenset[int]


@dataclass(slots=True)
class Contents:
    """What a file says of itself, in its summary or read from beginning to end.

    Attributes:
        channels: by number.
        chunks: in the order of the file.
        counts: messages of each channel where known.
    """

    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    chunks: list[ChunkPlace] = field(default_factory=list[ChunkPlace])
    counts: dict[int, int] = field(default_factory=dict[int, int])
    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict[int, tuple[str, str, bytes]])

    def take(self, kind: int, body: memoryview) -> None:
        """Learn from a record; kinds that tell nothing here are passed over.

        Raises:
            RecordError, struct.error, UnicodeDecodeError: it contradicts itself.
        """
        if kind == SCHEMA:
            (number,) = struct.unpack_from("<H", body)
            name, place = _text(body, 2)
            encoding, place = _text(body, place)
            data, _ = _sized(body, place)
            self.schemas[number] = (name, encoding, bytes(data))
        elif kind == CHANNEL:
            number, schema = struct.unpack_from("<HH", body)
            topic, place = _text(body, 4)
            encoding, _ = _text(body, place)
            self.channels[number] = Channel(number, topic, encoding, *self.schemas.get(schema, ("", "", b"")))
        elif kind == CHUNK_INDEX:
            _, _, start, length = struct.unpack_from("<QQQQ", body)
            offsets, _ = _sized(body, 32)
            if len(offsets) % 10:
                raise RecordError("a chunk's index is not whole")
            channels = frozenset(int(number) for number, _ in struct.iter_unpack("<HQ", offsets))
            self.chunks.append(ChunkPlace(start, length, channels))
        elif kind == STATISTICS:
            counts, _ = _sized(body, 42)
            if len(counts) % 10:
                raise RecordError("the statistics are not whole")
            self.counts = dict(struct.iter_unpack("<HQ", counts))


def _sized(body: memoryview, place: int) -> tuple[memoryview, int]:
    (size,) = struct.unpack_from("<I", body, place)
    if size > len(body) - place - 4:
        raise RecordError(f"a part of {size} bytes goes past the end of its record")
    return body[place + 4 : place + 4 + size], place + 4 + size


def _text(body: memoryview, place: int) -> tuple[str, int]:
    data, place = _sized(body, place)
    return bytes(data).decode(), place


def records(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """(kind, body) of the records in a piece of memory.

    Raises:
        RecordError: one goes past the end.
    """
    place = 0
    while place < len(data):
        if len(data) - place < _HEAD.size:
            raise RecordError("a record begins where its chunk ends")
        kind, size = _HEAD.unpack_from(data, place)
        place += _HEAD.size
        if size > len(data) - place:
            raise RecordError(f"a record of {size} bytes goes past the end of its chunk")
        yield kind, data[place : place + size]
        place += size


def head_of(file: BinaryIO) -> tuple[int, int] | None:
    """Kind and size of the record at the file's position, None where the file ends before or in its head."""
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    kind, size = _HEAD.unpack(head)
    return kind, size


def message_of(body: memoryview) -> tuple[int, int, bytes]:
    """Channel, time of recording and content of a message record.

    Raises:
        struct.error: it is too short.
    """
    channel, _, log_ns, _ = _MESSAGE.unpack_from(body)
    return channel, log_ns, bytes(body[_MESSAGE.size :])


def unpacked_chunk(body: memoryview) -> memoryview:
    """The records of a chunk record.

    Raises:
        RecordError: a compression or a size that cannot be.
        ExpandsError: more comes out than the chunk says, or than is read.
        zstandard.ZstdError, RuntimeError: it does not decompress.
    """
    _, _, size, checksum = _CHUNK.unpack_from(body)
    compression, place = _text(body, _CHUNK.size)
    (stored,) = struct.unpack_from("<Q", body, place)
    data = body[place + 8 :]
    if stored > len(data):
        raise RecordError("a chunk goes past its end")
    if size > MAX_CHUNK_BYTES:
        raise ExpandsError(f"a chunk claims {size} bytes; at most {MAX_CHUNK_BYTES} are read")
    data = data[:stored]
    if compression not in ("", "zstd", "lz4"):
        raise RecordError(f"a chunk is compressed by {compression[:20]!r}")
    if compression:
        data = memoryview(decompress_zstd(data, size) if compression == "zstd" else decompress_lz4(data, size))
    if len(data) != size:
        raise RecordError(f"a chunk of {size} bytes holds {len(data)}")
    if checksum and zlib.crc32(data) != checksum:
        raise RecordError("a chunk does not have its checksum")
    return data
