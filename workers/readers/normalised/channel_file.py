"""An MCAP file with one channel, written as the format's specification says; what is large is not copied.

The mcap library's own writer copies each message about five times and compresses at one fixed level, which took more
of an ingestion than the decoding of the packets. Its record types write everything here that is small.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, Final

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
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

from workers.readers.output import create

Part = bytes | bytearray | memoryview

CHUNK_BYTES: Final = 1 << 20
_MAGIC: Final = b"\x89MCAP0\r\n"
_MESSAGE: Final = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_CHUNK: Final = struct.Struct("<BQQQQI")  # opcode, length, start, end, uncompressed size, CRC
_CHANNEL: Final = 1


class ChannelFile:
    """An MCAP file while it is written: chunks of messages, their index, one metadata record.

    Args:
        path: is made, or overwritten.
        topic: of the one channel; its messages are CDR.
        schema: name and text of the message type, in ROS 2's notation.
        level: zstd level of the chunks; None: not compressed, so that each message is a byte range of the file.
    """

    def __init__(self, path: Path, topic: str, schema: tuple[str, str], level: int | None) -> None:
        self.path = path
        self.count = 0
        self._file: BinaryIO = create(path)
        self._compressor = None if level is None else zstandard.ZstdCompressor(level=level)
        self._schema = Schema(id=1, name=schema[0], encoding="ros2msg", data=schema[1].encode())
        self._channel = Channel(id=_CHANNEL, schema_id=1, topic=topic, message_encoding="cdr", metadata={})
        self._chunks: list[ChunkIndex] = []
        self._parts: list[Part] = []
        self._entries = array("Q")  # log time and offset in the chunk, of each of its messages
        self._size = 0
        self._file.write(_MAGIC)
        self._file.write(_records(Header(profile="ros2", library="apexcal"), self._schema, self._channel))

    def add(self, stamp_ns: int, *message: Part) -> None:
        """Append one message, given in parts; they must not change before the file is finished."""
        length = sum(len(part) for part in message)
        head = _MESSAGE.pack(Opcode.MESSAGE, 22 + length, _CHANNEL, self.count & 0xFFFFFFFF, stamp_ns, stamp_ns)
        self._entries.extend((stamp_ns, self._size))
        self._parts += (head, *message)
        self._size += len(head) + length
        self.count += 1
        if self._size >= CHUNK_BYTES:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if not self._entries:
            return
        crc = 0
        for part in self._parts:
            crc = zlib.crc32(part, crc)
        parts: Sequence[Part] = self._parts
        name = b""
        if self._compressor is not None:
            parts, name = [self._compressor.compress(b"".join(self._parts))], b"zstd"
        stored = sum(len(part) for part in parts)
        times = self._entries[::2]
        first, last = min(times), max(times)
        length = _CHUNK.size - 9 + 4 + len(name) + 8 + stored
        entries = struct.pack(f"<{len(self._entries)}Q", *self._entries)
        index = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(entries), _CHANNEL, len(entries)) + entries
        start = self._file.tell()
        self._file.write(_CHUNK.pack(Opcode.CHUNK, length, first, last, self._size, crc))
        self._file.write(struct.pack("<I", len(name)) + name + struct.pack("<Q", stored))
        self._file.writelines(parts)
        self._file.write(index)
        self._chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=length + 9,
                message_index_offsets={_CHANNEL: start + length + 9},
                message_index_length=len(index),
                compression=name.decode(),
                compressed_size=stored,
                uncompressed_size=self._size,
            )
        )
        self._parts, self._entries, self._size = [], array("Q"), 0

    def finish(self, metadata_name: str, facts: dict[str, str]) -> None:
        """Write the metadata record and the summary, and close."""
        self._end_chunk()
        metadata_at = self._file.tell()
        metadata = _records(Metadata(name=metadata_name, metadata=facts))
        self._file.write(metadata + _records(DataEnd(0)))
        starts = [chunk.message_start_time for chunk in self._chunks]
        ends = [chunk.message_end_time for chunk in self._chunks]
        statistics = Statistics(
            attachment_count=0,
            channel_count=1,
            channel_message_counts={_CHANNEL: self.count},
            chunk_count=len(self._chunks),
            message_count=self.count,
            metadata_count=1,
            message_start_time=min(starts, default=0),
            message_end_time=max(ends, default=0),
            schema_count=1,
        )
        groups = (
            (Opcode.SCHEMA, [self._schema]),
            (Opcode.CHANNEL, [self._channel]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, [MetadataIndex(metadata_at, len(metadata), metadata_name)]),
        )
        self._write_summary(groups)
        self._file.close()

    def _write_summary(self, groups: Sequence[tuple[Opcode, Sequence[McapRecord]]]) -> None:
        start = self._file.tell()
        summary = b""
        offsets: list[SummaryOffset] = []
        for opcode, records in groups:
            group = _records(*records)
            if group:
                offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offsets_at = start + len(summary)
        summary += _records(*offsets)
        crc = zlib.crc32(summary + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_at))
        self._file.write(summary)
        self._file.write(_records(Footer(summary_start=start, summary_offset_start=offsets_at, summary_crc=crc)))
        self._file.write(_MAGIC)

    def abandon(self) -> None:
        """Close without finishing; what is on disk is of no use."""
        self._file.close()


def _records(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
