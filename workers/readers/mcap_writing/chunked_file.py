"""An MCAP file of chunks, written as the format's specification says. Large messages are not copied.

The mcap library's own writer copies each message about five times and compresses at one fixed level, which took more
of an ingestion than the decoding of the packets. Its record types write everything here that is small.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, Final

import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Header, Metadata, MetadataIndex, Schema

from workers.readers.mcap_writing.summary import Summary, written
from workers.readers.output import create
from workers.readers.ros.mcap_records import MAGIC

Part = bytes | bytearray | memoryview

CHUNK_BYTES: Final = 1 << 20
_MESSAGE: Final = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_CHUNK: Final = struct.Struct("<BQQQQI")  # opcode, length, start, end, uncompressed size, CRC


class ChunkedFile:
    """An MCAP file while it is written: schemas and channels first, then messages, then metadata.

    Args:
        path: is made, or overwritten.
        profile: as the format's specification lists them; empty: none.
        level: zstd level of the chunks; None: not compressed, so that each message is a byte range of the file.
    """

    def __init__(self, path: Path, profile: str, level: int | None) -> None:
        self.path = path
        self._file: BinaryIO = create(path)
        self._compressor = None if level is None else zstandard.ZstdCompressor(level=level)
        self._summary = Summary()
        self._parts: list[Part] = []
        self._entries: dict[int, array[int]] = {}  # of each channel: log times and offsets in the chunk
        self._size = 0
        self._file.write(MAGIC)
        self._file.write(written(Header(profile=profile, library="apexcal")))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """A type of messages. Returns its number."""
        schema = Schema(id=len(self._summary.schemas) + 1, name=name, encoding=encoding, data=data)
        self._summary.schemas[schema.id] = schema
        self._file.write(written(schema))
        return schema.id

    def add_channel(self, topic: str, schema: int, encoding: str) -> int:
        """A topic, with the encoding of its messages. Returns its number."""
        number = len(self._summary.channels) + 1
        channel = Channel(id=number, schema_id=schema, topic=topic, message_encoding=encoding, metadata={})
        self._summary.channels[number] = channel
        self._file.write(written(channel))
        return number

    def count(self, channel: int) -> int:
        """How many messages a channel has."""
        return self._summary.counts.get(channel, 0)

    def add(self, channel: int, stamp_ns: int, *message: Part) -> None:
        """Append one message, given in parts; they must not change before the file is finished."""
        length = sum(len(part) for part in message)
        sequence = self.count(channel) & 0xFFFFFFFF
        head = _MESSAGE.pack(Opcode.MESSAGE, 22 + length, channel, sequence, stamp_ns, stamp_ns)
        self._entries.setdefault(channel, array("Q")).extend((stamp_ns, self._size))
        self._summary.count(channel, stamp_ns)
        self._parts += (head, *message)
        self._size += len(head) + length
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
        first = min(min(entries[::2]) for entries in self._entries.values())
        last = max(max(entries[::2]) for entries in self._entries.values())
        length = _CHUNK.size - 9 + 4 + len(name) + 8 + stored
        start = self._file.tell()
        self._file.write(_CHUNK.pack(Opcode.CHUNK, length, first, last, self._size, crc))
        self._file.write(struct.pack("<I", len(name)) + name + struct.pack("<Q", stored))
        self._file.writelines(parts)
        indexes_at = start + length + 9
        self._summary.chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=length + 9,
                message_index_offsets=self._write_indexes(indexes_at),
                message_index_length=self._file.tell() - indexes_at,
                compression=name.decode(),
                compressed_size=stored,
                uncompressed_size=self._size,
            )
        )
        self._parts, self._entries, self._size = [], {}, 0

    def _write_indexes(self, place: int) -> dict[int, int]:
        """A record for each channel of the chunk. Returns where they stand."""
        offsets: dict[int, int] = {}
        for channel, listed in self._entries.items():
            entries = struct.pack(f"<{len(listed)}Q", *listed)
            index = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries
            self._file.write(index)
            offsets[channel] = place
            place += len(index)
        return offsets

    def finish(self, metadata_name: str, facts: Mapping[str, str]) -> None:
        """Write the metadata record and the summary, and close."""
        self._end_chunk()
        start = self._file.tell()
        metadata = written(Metadata(name=metadata_name, metadata=dict(facts)))
        self._file.write(metadata)
        self._summary.metadata.append(MetadataIndex(start, len(metadata), metadata_name))
        self._summary.write(self._file)
        self._file.close()

    def abandon(self) -> None:
        """Close without finishing; what is on disk is of no use."""
        self._file.close()
