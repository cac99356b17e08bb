"""An MCAP file, message by message into a new one of the same profile and compression."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata
from mcap.writer import CompressionType, Writer

from workers.readers.copying.editor import Added, Editor
from workers.readers.copying.edits import Edits
from workers.readers.mcap_io.records import MESSAGE, chunk_head
from workers.readers.output import create
from workers.readers.ros.mcap_bag import McapBag

_COMPRESSIONS: Final = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4}


def copy_mcap(path: Path, out: Path, edits: Edits, is_first: bool, on_done: Callable[[float], None]) -> Editor:
    """Copy a file. ``is_first``: whether new poses go into it.

    Raises:
        ReadError: as :class:`McapBag` and :class:`Editor` do.
    """
    with closing(McapBag(path)) as bag, create(out) as file:
        editor = Editor(bag, edits)
        with bag.damage():
            _Copy(bag, file, editor, is_first).run(on_done)
    return editor


class _Copy:
    def __init__(self, bag: McapBag, file: BinaryIO, editor: Editor, is_first: bool) -> None:
        self._bag, self._editor = bag, editor
        self._says_first = is_first
        header, chunk = _first(bag, Opcode.HEADER), _first(bag, Opcode.CHUNK)
        compression = _COMPRESSIONS.get(chunk_head(chunk)[1], CompressionType.NONE) if chunk else CompressionType.NONE
        self._writer = Writer(file, compression=compression)
        self._writer.start(Header.read(ReadDataStream(BytesIO(header))).profile if header else "", "apexcal")
        schemas = {0: 0}
        for number, schema in bag.contents.schemas.items():
            schemas[number] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        # By the number in the bag: topic, and number in the copy.
        self._channels = {
            number: (
                each.topic,
                self._writer.register_channel(
                    each.topic, each.message_encoding, schemas[each.schema_id], each.metadata
                ),
            )
            for number, each in bag.contents.channels.items()
        }
        self._numbers = dict(reversed(self._channels.values()))
        for topic in editor.new_topics:
            is_ros1 = topic.encoding == "ros1"
            name, form = (topic.type.replace("/msg/", "/"), "ros1msg") if is_ros1 else (topic.type, "ros2msg")
            schema = self._writer.register_schema(name, form, topic.definition.encode())
            facts = {} if is_ros1 else {"offered_qos_profiles": topic.qos}
            self._numbers[topic.name] = self._writer.register_channel(topic.name, topic.encoding, schema, facts)

    def run(self, on_done: Callable[[float], None]) -> None:
        """Walk over the file, then write the new summary."""
        for _, kind, size in self._bag.walk():
            if kind in (Opcode.CHUNK, Opcode.MESSAGE):
                for inner, part in self._bag.records(kind, size):
                    if inner == Opcode.MESSAGE:
                        self._take(part)
            elif kind == Opcode.ATTACHMENT:
                extra = Attachment.read(ReadDataStream(BytesIO(self._bag.file.read(size))))
                self._writer.add_attachment(
                    extra.create_time, extra.log_time, extra.name, extra.media_type, extra.data
                )
            elif kind == Opcode.METADATA:
                facts = Metadata.read(ReadDataStream(BytesIO(self._bag.body(size))))
                self._writer.add_metadata(facts.name, facts.metadata)
            on_done(self._bag.share_read)
        self._writer.finish()

    def _take(self, body: memoryview) -> None:
        """Copy or replace a message, and write what follows it."""
        channel, sequence, log_ns, publish_ns = MESSAGE.unpack_from(body)
        topic, number = self._channels[channel]
        message = bytes(body[MESSAGE.size :])
        added: list[Added] = []
        if self._says_first:
            self._says_first = False
            added += self._editor.begin(log_ns)
        if topic in self._editor.watched:
            message, beside = self._editor.take(topic, log_ns, message)
            added += beside
        else:
            self._editor.counts.copied += 1
        self._writer.add_message(number, log_ns, message, publish_ns, sequence)
        for each in added:
            self._writer.add_message(self._numbers[each.topic], each.log_ns, each.data, each.log_ns)


def _first(bag: McapBag, kind: Opcode) -> memoryview | None:
    """The body of the first record of a kind."""
    return next((bag.body(size) for _, each, size in bag.walk() if each == kind), None)
