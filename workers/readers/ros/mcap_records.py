"""The records of an MCAP file. The library mcap parses those that are read once for a file.

Messages and chunks are parsed here, without a copy. A chunk never unpacks to more than it says or than is read
(docs/decisions/0039).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from workers.readers.bounded import ExpandsError, decompress_lz4, decompress_zstd
from workers.readers.detect import MCAP

FOOTER_BYTES: Final = 9 + 20 + len(MCAP)
# One message is all that a chunk must hold; no sensor's is larger.
MAX_CHUNK_BYTES: Final = 160 * 1024**2
HEAD: Final = struct.Struct("<BQ")
MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK: Final = struct.Struct("<QQQII")  # start, end, size unpacked, checksum, length of the compression's name


class RecordError(ValueError):
    """Bytes that are no MCAP record."""


@dataclass(frozen=True, slots=True)
class ChunkPlace:
    """The place of a chunk, and the channels with messages in it (empty: not stated)."""

    start: int
    length: int
    channels: frozenset[int]


@dataclass(slots=True)
class McapContents:
    """A file's contents, by its summary or read from beginning to end.

    Attributes:
        channels: by number.
        schemas: by number.
        chunks: in the order of the file.
        counts: messages of each channel where known.
    """

    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    chunks: list[ChunkPlace] = field(default_factory=list[ChunkPlace])
    counts: dict[int, int] = field(default_factory=dict[int, int])

    def take(self, kind: int, body: memoryview) -> None:
        """Learn from a record; kinds that tell nothing here are passed over.

        Raises:
            McapError, struct.error, UnicodeDecodeError: it contradicts itself.
        """
        stream = ReadDataStream(BytesIO(body))
        if kind == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema
        elif kind == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels[channel.id] = channel
        elif kind == Opcode.CHUNK_INDEX:
            index = ChunkIndex.read(stream)
            channels = frozenset(index.message_index_offsets)
            self.chunks.append(ChunkPlace(index.chunk_start_offset, index.chunk_length, channels))
        elif kind == Opcode.STATISTICS:
            self.counts = Statistics.read(stream).channel_message_counts

    def count(self, message: memoryview) -> int:
        """Count one more message, by its record, and return its channel.

        Raises:
            struct.error: it is too short.
        """
        (channel,) = struct.unpack_from("<H", message)
        self.counts[channel] = self.counts.get(channel, 0) + 1
        return int(channel)


def records(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """(kind, body) of the records in a piece of memory.

    Raises:
        RecordError: one goes past the end.
    """
    offset = 0
    while offset < len(data):
        if len(data) - offset < HEAD.size:
            raise RecordError("a record begins where its chunk ends")
        kind, size = HEAD.unpack_from(data, offset)
        offset += HEAD.size
        if size > len(data) - offset:
            raise RecordError(f"a record of {size} bytes goes past the end of its chunk")
        yield kind, data[offset : offset + size]
        offset += size


def message_of(body: memoryview) -> tuple[int, int, bytes]:
    """Channel, time of recording and content of a message record.

    Raises:
        struct.error: it is too short.
        RecordError: its time lies past the year 2262, where 64 bits with a sign end.
    """
    channel, _, log_ns, _ = MESSAGE.unpack_from(body)
    if log_ns >= 2**63:
        raise RecordError(f"a message was recorded at {log_ns} ns, past the year 2262")
    return channel, log_ns, bytes(body[MESSAGE.size :])


def chunk_head(body: bytes | memoryview) -> tuple[int, str]:
    """Return where the stored records of a chunk record begin, and their compression.

    Raises:
        struct.error, UnicodeDecodeError: it ends too early.
    """
    end = CHUNK.size + CHUNK.unpack_from(body)[-1]
    return end + 8, bytes(body[CHUNK.size : end]).decode()


def unpacked_chunk(body: memoryview) -> memoryview:
    """The records of a chunk record.

    Raises:
        RecordError: a compression or a size that cannot be.
        ExpandsError: more comes out than the chunk says, or than is read.
        struct.error, UnicodeDecodeError: it ends too early.
        zstandard.ZstdError, RuntimeError: it does not decompress.
    """
    _, _, size, checksum, _ = CHUNK.unpack_from(body)
    start, compression = chunk_head(body)
    (stored,) = struct.unpack_from("<Q", body, start - 8)
    data = body[start:]
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
