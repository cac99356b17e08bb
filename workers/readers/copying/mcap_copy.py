"""An MCAP file, record by record into a new one.

Chunks without a message that is replaced are copied as they are. Of others only the messages that are replaced
change; chunks keep their compression. Messages that are added stand in chunks of their own, near their time.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, Final

import zstandard
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, MetadataIndex, Schema

from workers.readers.copying.editor import Added, Editor, NewTopic
from workers.readers.copying.edits import Edits
from workers.readers.copying.messages import ros1_types
from workers.readers.copying.qos import LATCHED_QOS, SENSOR_QOS
from workers.readers.mcap_writing.summary import Summary, written
from workers.readers.output import create
from workers.readers.ros.mcap_bag import McapBag
from workers.readers.ros.mcap_records import MAGIC, MAX_CHUNK_BYTES, RecordError, head_of, records, unpacked_chunk
from workers.readers.ros.ros_types import fixed_types

_HEAD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_CHUNK: Final = struct.Struct("<QQQII")  # start, end, size unpacked, checksum, length of the compression's name
_PIECE: Final = 1 << 20


def copy_mcap(path: Path, out: Path, edits: Edits, is_first: bool, on_done: Callable[[float], None]) -> Editor:
    """Copy a file. ``is_first``: whether new poses go into it.

    Raises:
        ReadError: as :class:`McapBag` and :class:`Editor` do.
    """
    bag = McapBag(path)
    try:
        editor = Editor(bag, edits)
        with bag.damage(), path.open("rb") as file, create(out) as made:
            _Copy(bag, file, made, editor, is_first).run(path.stat().st_size, on_done)
    finally:
        bag.close()
    return editor


class _Copy:
    def __init__(self, bag: McapBag, file: BinaryIO, made: BinaryIO, editor: Editor, is_first: bool) -> None:
        self._file, self._made, self._editor = file, made, editor
        self._says_first = is_first
        contents = bag.contents
        self._topics = {number: channel.topic for number, channel in contents.channels.items()}
        self._known = (set(contents.schemas), set(contents.channels))
        self._summary = Summary(dict(contents.schemas), dict(contents.channels))
        self._new: dict[str, int] = {}
        self._pending: list[Added] = []

    def run(self, size: int, on_done: Callable[[float], None]) -> None:
        """Walk over the file, then write the new summary."""
        place = len(MAGIC)
        self._file.seek(place)
        self._made.write(MAGIC)
        while True:
            head = head_of(self._file)
            if head is None or head[0] in (Opcode.DATA_END, Opcode.FOOTER) or head[1] > size - place - 9:
                break
            kind, length = head
            self._take(kind, length)
            place += 9 + length
            self._file.seek(place)
            on_done(place / size)
        self._flush()
        self._summary.write(self._made)

    def _take(self, kind: int, length: int) -> None:
        if kind == Opcode.MESSAGE_INDEX:  # written anew behind its chunk
            return
        if kind in (Opcode.ATTACHMENT, Opcode.METADATA):
            self._take_extra(kind, length)
            return
        if length > MAX_CHUNK_BYTES:
            raise RecordError(f"a record claims {length} bytes; at most {MAX_CHUNK_BYTES} are read")
        body = self._file.read(length)
        if kind == Opcode.CHUNK:
            self._flush()
            self._take_chunk(body)
        elif kind == Opcode.MESSAGE:
            self._flush()
            self._made.write(self._message(memoryview(body))[0])
        else:
            self._made.write(_HEAD.pack(kind, length) + body)
            if kind == Opcode.HEADER:
                self._add_channels()

    def _take_extra(self, kind: int, length: int) -> None:
        """Attachments may be larger than memory."""
        start = self._made.tell()
        self._made.write(_HEAD.pack(kind, length))
        left = length
        while left and (piece := self._file.read(min(left, _PIECE))):
            if left == length:
                self._index_extra(kind, piece, start, length)
            self._made.write(piece)
            left -= len(piece)

    def _index_extra(self, kind: int, piece: bytes, start: int, length: int) -> None:
        if kind == Opcode.METADATA:
            (size,) = struct.unpack_from("<I", piece)
            name = piece[4 : 4 + size].decode()
            self._summary.metadata.append(MetadataIndex(offset=start, length=length + 9, name=name))
            return
        log_ns, create_ns, size = struct.unpack_from("<QQI", piece)
        name = piece[20 : 20 + size].decode()
        at = 20 + size
        (kind_size,) = struct.unpack_from("<I", piece, at)
        media_type = piece[at + 4 : at + 4 + kind_size].decode()
        (data_size,) = struct.unpack_from("<Q", piece, at + 4 + kind_size)
        self._summary.attachments.append(
            AttachmentIndex(
                offset=start,
                length=length + 9,
                log_time=log_ns,
                create_time=create_ns,
                data_size=data_size,
                name=name,
                media_type=media_type,
            )
        )

    def _take_chunk(self, body: bytes) -> None:
        """A chunk as it is, or with messages replaced; and its message indexes."""
        _, _, _, _, name_length = _CHUNK.unpack_from(body)
        compression = body[_CHUNK.size : _CHUNK.size + name_length].decode()
        made: list[bytes] = []
        has_changed = False
        for kind, part in records(unpacked_chunk(memoryview(body))):
            if kind != Opcode.MESSAGE:
                made.append(_HEAD.pack(kind, len(part)) + bytes(part))
                continue
            record, is_changed = self._message(part)
            has_changed = has_changed or is_changed
            made.append(record)
        self._write_chunk(made, compression, None if has_changed else body)

    def _message(self, part: memoryview) -> tuple[bytes, bool]:
        """The record of a message as it is to be written, and whether its content has changed."""
        channel, _, log_ns, _ = _MESSAGE.unpack_from(part)
        topic = self._topics.get(channel, "")
        if self._says_first:
            self._says_first = False
            self._pending += self._editor.first(log_ns)
        raw = bytes(part[_MESSAGE.size :])
        if topic in self._editor.watched:
            made = self._editor.edited(topic, raw)
            self._pending += self._editor.following(topic, log_ns, raw)
        else:
            made = raw
            self._editor.counts.copied += 1
        self._summary.count(channel, log_ns)
        head = _HEAD.pack(Opcode.MESSAGE, _MESSAGE.size + len(made))
        return b"".join((head, part[: _MESSAGE.size], made)), made is not raw

    def _flush(self) -> None:
        """Write what was added since, as a chunk of its own."""
        parts: list[bytes] = []
        for number, one in enumerate(self._pending):
            channel = self._new.get(one.topic) or self._channel_of(one.topic)
            numbers = _MESSAGE.pack(channel, number, one.log_ns, one.log_ns)
            parts.append(_HEAD.pack(Opcode.MESSAGE, _MESSAGE.size + len(one.data)) + numbers + one.data)
            self._summary.count(channel, one.log_ns)
        self._pending = []
        if parts:
            self._write_chunk(parts, "zstd", None)

    def _channel_of(self, topic: str) -> int:
        return next(number for number, name in self._topics.items() if name == topic)

    def _write_chunk(self, parts: list[bytes], compression: str, as_it_was: bytes | None) -> None:
        """``as_it_was``: the chunk's body if nothing of it changed."""
        entries: dict[int, list[int]] = {}
        times: list[int] = []
        place = 0
        for part in parts:
            if part[0] == Opcode.MESSAGE:
                channel, _, log_ns, _ = _MESSAGE.unpack_from(part, _HEAD.size)
                entries.setdefault(channel, []).extend((log_ns, place))
                times.append(log_ns)
            place += len(part)
        body = as_it_was or _chunk(b"".join(parts), compression, min(times, default=0), max(times, default=0))
        first_ns, last_ns, size, _, name_length = _CHUNK.unpack_from(body)
        start = self._made.tell()
        self._made.write(_HEAD.pack(Opcode.CHUNK, len(body)))
        self._made.write(body)
        indexes_at = self._made.tell()
        offsets: dict[int, int] = {}
        for channel, pairs in entries.items():
            offsets[channel] = self._made.tell()
            packed = struct.pack(f"<{len(pairs)}Q", *pairs)
            index = struct.pack("<HI", channel, len(packed)) + packed
            self._made.write(_HEAD.pack(Opcode.MESSAGE_INDEX, len(index)) + index)
        self._summary.chunks.append(
            ChunkIndex(
                chunk_length=len(body) + _HEAD.size,
                chunk_start_offset=start,
                compression=compression,
                compressed_size=len(body) - _CHUNK.size - name_length - 8,
                message_end_time=last_ns,
                message_index_length=self._made.tell() - indexes_at,
                message_index_offsets=offsets,
                message_start_time=first_ns,
                uncompressed_size=size,
            )
        )

    def _add_channels(self) -> None:
        """Schemas and channels of the topics that are added, behind the header."""
        schemas, channels = self._known
        for topic in self._editor.new_topics:
            schema = Schema(id=_free(schemas), name=topic.type, encoding="ros2msg", data=_definition(topic))
            if topic.encoding == "ros1":
                schema = Schema(schema.id, _ros1_definition(topic), "ros1msg", topic.type.replace("/msg/", "/"))
            schemas.add(schema.id)
            qos = {} if topic.encoding == "ros1" else {"offered_qos_profiles": _qos(topic)}
            channel = Channel(
                id=_free(channels),
                topic=topic.name,
                message_encoding=topic.encoding,
                metadata=qos,
                schema_id=schema.id,
            )
            channels.add(channel.id)
            self._summary.schemas[schema.id], self._summary.channels[channel.id] = schema, channel
            self._new[topic.name] = channel.id
            self._made.write(written(schema, channel))


def _chunk(data: bytes, compression: str, first_ns: int, last_ns: int) -> bytes:
    """The body of a chunk record."""
    packed = data
    if compression == "zstd":
        packed = zstandard.ZstdCompressor().compress(data)
    elif compression == "lz4":
        lz4: Any = import_module("lz4.frame")  # without types
        packed = lz4.compress(data)
    name = compression.encode()
    head = _CHUNK.pack(first_ns, last_ns, len(data), zlib.crc32(data), len(name))
    return head + name + struct.pack("<Q", len(packed)) + packed


def _definition(topic: NewTopic) -> bytes:
    return fixed_types("cdr").generate_msgdef(topic.type, ros_version=2)[0].encode()


def _ros1_definition(topic: NewTopic) -> bytes:
    return ros1_types().generate_msgdef(topic.type)[0].encode()


def _qos(topic: NewTopic) -> str:
    return LATCHED_QOS if topic.latched else SENSOR_QOS


def _free(used: set[int]) -> int:
    return max(used, default=0) + 1
