"""An MCAP file of chunks, written as the format's specification says. Large messages are not copied.

The mcap library's own writer copies each message about five times and compresses at one fixed level, which took more
of an ingestion than the decoding of the packets. Its record types write everything here that is small.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, Final

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from workers.readers.detect import MCAP
from workers.readers.mcap_io.records import CHUNK, HEAD, MESSAGE, chunk_head
from workers.readers.output import create

Part = bytes | bytearray | memoryview

CHUNK_BYTES: Final = 1 << 20


@dataclass(slots=True)
class McapSummary:
    """What a file says of itself at its end: schemas, channels, indexes and counts. Times are nanoseconds."""

    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    chunks: list[ChunkIndex] = field(default_factory=list[ChunkIndex])
    attachments: list[AttachmentIndex] = field(default_factory=list[AttachmentIndex])
    metadata: list[MetadataIndex] = field(default_factory=list[MetadataIndex])
    counts: dict[int, int] = field(default_factory=dict[int, int])
    first_ns: int = 2**64 - 1
    last_ns: int = 0

    def count(self, channel: int, log_ns: int) -> None:
        """One more message."""
        self.counts[channel] = self.counts.get(channel, 0) + 1
        self.first_ns, self.last_ns = min(self.first_ns, log_ns), max(self.last_ns, log_ns)

    def packed(self, start: int) -> bytes:
        """McapSummary, footer and magic, as they stand in the file from byte ``start`` on."""
        statistics = Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            message_end_time=self.last_ns,
            message_start_time=self.first_ns if self.counts else 0,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, self.attachments),
            (Opcode.METADATA_INDEX, self.metadata),
        ]
        text = b""
        offsets: list[SummaryOffset] = []
        for opcode, listed in groups:
            if listed:
                group = serialised(*listed)
                offsets.append(SummaryOffset(opcode, start + len(text), len(group)))
                text += group
        offsets_at = start + len(text)
        text += serialised(*offsets)
        crc = zlib.crc32(text + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_at))
        footer = Footer(summary_crc=crc, summary_offset_start=offsets_at, summary_start=start)
        return text + serialised(footer) + MCAP


class McapWriter:
    """An MCAP file while it is written: schemas and channels first, then messages, then metadata.

    Args:
        path: is made, or overwritten.
        profile: as the format's specification lists them; empty: none. None: the header is written as a record.
        compression: of the chunks: empty, ``zstd`` or ``lz4``. Where it is empty, each message is a byte range.
        level: zstd's.

    Attributes:
        summary: what the file will say of itself.
        ends: where each message ends in the file, in the order added; only without compression.
    """

    def __init__(self, path: Path, profile: str | None, compression: str = "", level: int = 3) -> None:
        self.path = path
        self.summary = McapSummary()
        self.ends = array("q")
        self._file: BinaryIO = create(path)
        self._compression = compression
        self._zstd = zstandard.ZstdCompressor(level=level)
        self._parts: list[Part] = []
        self._entries: dict[int, array[int]] = {}  # of each channel: log times and offsets in the chunk
        self._ends = array("q")  # of each message, in the chunk
        self._size = 0
        self._file.write(MCAP)
        if profile is not None:
            self._file.write(serialised(Header(profile=profile, library="apexcal")))

    def tell(self) -> int:
        """Bytes of the file so far, without the open chunk."""
        return self._file.tell()

    def write(self, *record: Part) -> None:
        """Append a record, given in parts, outside of chunks."""
        self._file.writelines(record)

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """A type of messages. Returns its number."""
        schema = Schema(id=max(self.summary.schemas, default=0) + 1, name=name, encoding=encoding, data=data)
        self.summary.schemas[schema.id] = schema
        self._file.write(serialised(schema))
        return schema.id

    def add_channel(self, topic: str, schema: int, encoding: str, metadata: Mapping[str, str] | None = None) -> int:
        """A topic, with the encoding of its messages. Returns its number."""
        number = max(self.summary.channels, default=0) + 1
        facts = dict(metadata or {})
        channel = Channel(id=number, schema_id=schema, topic=topic, message_encoding=encoding, metadata=facts)
        self.summary.channels[number] = channel
        self._file.write(serialised(channel))
        return number

    def add(self, channel: int, stamp_ns: int, *message: Part) -> None:
        """Append one message, given in parts; they must not change before the file is finished."""
        sequence = self.summary.counts.get(channel, 0) & 0xFFFFFFFF
        self.put_message(channel, stamp_ns, MESSAGE.pack(channel, sequence, stamp_ns, stamp_ns), *message)
        if self._size >= CHUNK_BYTES:
            self.end_chunk()

    def put_message(self, channel: int, stamp_ns: int, *body: Part) -> None:
        """Append a message record to the open chunk, whatever its size."""
        self._entries.setdefault(channel, array("Q")).extend((stamp_ns, self._size))
        self.summary.count(channel, stamp_ns)
        self.put(Opcode.MESSAGE, *body)
        self._ends.append(self._size)

    def put(self, kind: int, *body: Part) -> None:
        """Append a record that is no message to the open chunk."""
        length = sum(len(part) for part in body)
        self._parts += (HEAD.pack(kind, length), *body)
        self._size += HEAD.size + length

    def end_chunk(self, compression: str | None = None, body: bytes | memoryview | None = None) -> None:
        """Write the open chunk, where it holds anything, and its indexes.

        Args:
            compression: instead of the file's.
            body: the chunk's record in another file, where it holds just what was put into this one.
        """
        if not self._parts:
            return
        if body is None:
            head, parts = self._packed(self._compression if compression is None else compression)
        else:
            stored_at, _ = chunk_head(body)
            head, parts = body[:stored_at], [body[stored_at:]]
        stored = sum(len(part) for part in parts)
        start = self._file.tell()
        self.write(HEAD.pack(Opcode.CHUNK, len(head) + stored), head, *parts)
        first, last, size, _, _ = CHUNK.unpack_from(head)
        indexes_at = start + HEAD.size + len(head) + stored
        self.summary.chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=indexes_at - start,
                message_index_offsets=self._write_indexes(indexes_at),
                message_index_length=self._file.tell() - indexes_at,
                compression=chunk_head(head)[1],
                compressed_size=stored,
                uncompressed_size=size,
            )
        )
        self.ends.extend(indexes_at - self._size + end for end in self._ends)
        self._parts, self._entries, self._ends, self._size = [], {}, array("q"), 0

    def _packed(self, compression: str) -> tuple[bytes, Sequence[Part]]:
        """The open chunk's record: all before the stored records, and these."""
        crc = 0
        for part in self._parts:
            crc = zlib.crc32(part, crc)
        parts = self._parts
        if compression == "zstd":
            parts = [self._zstd.compress(b"".join(parts))]
        elif compression == "lz4":
            lz4: Any = import_module("lz4.frame")  # without types
            parts = [lz4.compress(b"".join(parts))]
        first = min((min(entries[::2]) for entries in self._entries.values()), default=0)
        last = max((max(entries[::2]) for entries in self._entries.values()), default=0)
        name = compression.encode()
        stored = sum(len(part) for part in parts)
        return CHUNK.pack(first, last, self._size, crc, len(name)) + name + struct.pack("<Q", stored), parts

    def _write_indexes(self, offset: int) -> dict[int, int]:
        """A record for each channel of the chunk. Returns where they stand."""
        offsets: dict[int, int] = {}
        for channel, listed in self._entries.items():
            entries = struct.pack(f"<{len(listed)}Q", *listed)
            self.write(struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)), entries)
            offsets[channel] = offset
            offset += 15 + len(entries)
        return offsets

    def add_metadata(self, name: str, facts: Mapping[str, str]) -> None:
        """Append a metadata record, behind the open chunk."""
        self.end_chunk()
        record = serialised(Metadata(name=name, metadata=dict(facts)))
        self.summary.metadata.append(MetadataIndex(self._file.tell(), len(record), name))
        self._file.write(record)

    def finish(self) -> None:
        """Write the summary, and close."""
        self.end_chunk()
        self._file.write(serialised(DataEnd(0)))
        self._file.write(self.summary.packed(self._file.tell()))
        self._file.close()

    def abandon(self) -> None:
        """Close without finishing; what is on disk is of no use."""
        self._file.close()


def serialised(*listed: McapRecord) -> bytes:
    """Records as they stand in a file."""
    builder = RecordBuilder()
    for record in listed:
        record.write(builder)
    return builder.end()
