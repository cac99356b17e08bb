"""What an MCAP file says of itself at its end, collected while it is written."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from workers.readers.ros.mcap_records import MAGIC


@dataclass(slots=True)
class Summary:
    """Schemas, channels, indexes and counts of a file. Times are nanoseconds."""

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

    def write(self, file: BinaryIO) -> None:
        """End the file: data end, summary, footer."""
        file.write(written(DataEnd(0)))
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self.chunks),
            (Opcode.ATTACHMENT_INDEX, self.attachments),
            (Opcode.METADATA_INDEX, self.metadata),
        ]
        start = file.tell()
        text = b""
        offsets: list[SummaryOffset] = []
        for opcode, listed in groups:
            if listed:
                group = written(*listed)
                offsets.append(SummaryOffset(opcode, start + len(text), len(group)))
                text += group
        offsets_at = start + len(text)
        text += written(*offsets)
        crc = zlib.crc32(text + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_at))
        file.write(text)
        file.write(written(Footer(summary_crc=crc, summary_offset_start=offsets_at, summary_start=start)))
        file.write(MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
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


def written(*listed: McapRecord) -> bytes:
    """Records as they stand in a file."""
    builder = RecordBuilder()
    for record in listed:
        record.write(builder)
    return builder.end()
