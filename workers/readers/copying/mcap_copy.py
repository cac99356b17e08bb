"""An MCAP file, record by record into a new one.

Chunks without a message that is replaced are copied as they are. Of others only the messages that are replaced
change; chunks keep their compression. Messages that are added stand in chunks of their own, near their time.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, MetadataIndex

from workers.readers.copying.editor import Added, Editor
from workers.readers.copying.edits import Edits
from workers.readers.mcap_io.records import HEAD, MESSAGE, chunk_head, records, unpacked_chunk
from workers.readers.mcap_io.writer import McapWriter
from workers.readers.ros.mcap_bag import McapBag

_PIECE: Final = 1 << 20


def copy_mcap(path: Path, out: Path, edits: Edits, is_first: bool, on_done: Callable[[float], None]) -> Editor:
    """Copy a file. ``is_first``: whether new poses go into it.

    Raises:
        ReadError: as :class:`McapBag` and :class:`Editor` do.
    """
    with closing(McapBag(path)) as bag:
        editor = Editor(bag, edits)
        writer = McapWriter(out, None, "zstd")
        try:
            with bag.damage():
                _Copy(bag, writer, editor, is_first).run(on_done)
        finally:
            writer.abandon()
    return editor


class _Copy:
    def __init__(self, bag: McapBag, writer: McapWriter, editor: Editor, is_first: bool) -> None:
        self._bag, self._writer, self._editor = bag, writer, editor
        self._says_first = is_first
        self._topics = {number: channel.topic for number, channel in bag.contents.channels.items()}
        self._numbers = {topic: number for number, topic in reversed(self._topics.items())}
        writer.summary.schemas |= bag.contents.schemas
        writer.summary.channels |= bag.contents.channels
        self._pending: list[Added] = []

    def run(self, on_done: Callable[[float], None]) -> None:
        """Walk over the file, then write the new summary."""
        for _, kind, size in self._bag.walk():
            if kind == Opcode.CHUNK:
                self._take_chunk(self._bag.body(size))
            elif kind == Opcode.MESSAGE:
                self._flush()
                head, data, _ = self._message(self._bag.body(size))
                channel, _, log_ns, _ = MESSAGE.unpack(head)
                self._writer.summary.count(channel, log_ns)
                self._writer.write(HEAD.pack(kind, len(head) + len(data)), head, data)
            elif kind in (Opcode.ATTACHMENT, Opcode.METADATA):
                self._take_extra(kind, size)
            elif kind != Opcode.MESSAGE_INDEX:  # written anew behind its chunk
                self._writer.write(HEAD.pack(kind, size), self._bag.body(size))
                if kind == Opcode.HEADER:
                    self._add_channels()
            on_done(self._bag.share_read)
        self._flush()
        self._writer.finish()

    def _take_extra(self, kind: int, size: int) -> None:
        """Attachments may be larger than memory."""
        start, left = self._writer.tell(), size
        self._writer.write(HEAD.pack(kind, size))
        while left and (piece := self._bag.file.read(min(left, _PIECE))):
            if left == size:
                self._index_extra(kind, piece, start, size + HEAD.size)
            self._writer.write(piece)
            left -= len(piece)

    def _index_extra(self, kind: int, piece: bytes, start: int, length: int) -> None:
        stream, summary = ReadDataStream(BytesIO(piece)), self._writer.summary
        if kind == Opcode.METADATA:
            summary.metadata.append(MetadataIndex(start, length, stream.read_prefixed_string()))
            return
        index = AttachmentIndex(
            offset=start,
            length=length,
            log_time=stream.read8(),
            create_time=stream.read8(),
            name=stream.read_prefixed_string(),
            media_type=stream.read_prefixed_string(),
            data_size=stream.read8(),
        )
        summary.attachments.append(index)

    def _take_chunk(self, body: memoryview) -> None:
        """A chunk as it is, or with messages replaced; and its message indexes."""
        self._flush()
        has_changed = False
        for kind, part in records(unpacked_chunk(body)):
            if kind != Opcode.MESSAGE:
                self._writer.put(kind, part)
                continue
            head, data, is_changed = self._message(part)
            has_changed = has_changed or is_changed
            channel, _, log_ns, _ = MESSAGE.unpack(head)
            self._writer.put_message(channel, log_ns, head, data)
        self._writer.end_chunk(chunk_head(body)[1], None if has_changed else body)

    def _message(self, part: memoryview) -> tuple[memoryview, bytes | memoryview, bool]:
        """A message's numbers and its content as it is to be written, and whether that has changed."""
        channel, _, log_ns, _ = MESSAGE.unpack_from(part)
        topic = self._topics.get(channel, "")
        if self._says_first:
            self._says_first = False
            self._pending += self._editor.begin(log_ns)
        head, raw = part[: MESSAGE.size], part[MESSAGE.size :]
        if topic not in self._editor.watched:
            self._editor.counts.copied += 1
            return head, raw, False
        data = bytes(raw)
        message, added = self._editor.take(topic, log_ns, data)
        self._pending += added
        return head, message, message is not data

    def _flush(self) -> None:
        """Write what was added since, as a chunk of its own."""
        for pending in self._pending:
            self._writer.add(self._numbers[pending.topic], pending.log_ns, pending.data)
        self._pending = []
        self._writer.end_chunk()

    def _add_channels(self) -> None:
        """Schemas and channels of the topics that are added, behind the header."""
        for topic in self._editor.new_topics:
            is_ros1 = topic.encoding == "ros1"
            name, encoding = (topic.type.replace("/msg/", "/"), "ros1msg") if is_ros1 else (topic.type, "ros2msg")
            schema = self._writer.add_schema(name, encoding, topic.definition.encode())
            facts = {} if is_ros1 else {"offered_qos_profiles": topic.qos}
            self._numbers[topic.name] = self._writer.add_channel(topic.name, schema, topic.encoding, facts)
