"""An MCAP file, message by message into a new one, which the library mcap writes.

Schemas, channels, attachments and metadata go with it; so do each message's times and sequence number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata
from mcap.writer import CompressionType, Writer

from workers.readers.copying.editor import Added, Editor
from workers.readers.copying.edits import EditCounts, Edits
from workers.readers.output import create
from workers.readers.ros.mcap_bag import McapBag
from workers.readers.ros.mcap_records import MESSAGE, chunk_head

_COMPRESSIONS: Final = {"": CompressionType.NONE, "lz4": CompressionType.LZ4}


def copy_mcap(path: Path, out: Path, edits: Edits, on_done: Callable[[float], None]) -> EditCounts:
    """Raises :class:`ReadError` as :class:`McapBag` and :class:`Editor` do."""
    with closing(McapBag(path)) as bag, create(out) as file:
        editor = Editor(bag, edits)
        with bag.damage():
            profile, compression = _form(bag)
            writer = Writer(file, compression=_COMPRESSIONS.get(compression, CompressionType.ZSTD))
            writer.start(profile=profile, library="apexcal")
            _Copy(bag, writer, editor).run(on_done)
            writer.finish()
    editor.check_complete()
    return editor.counts


def _form(bag: McapBag) -> tuple[str, str]:
    """The file's profile, and by what its first chunk is compressed."""
    profile = ""
    for _, kind, size in bag.walk():
        if kind == Opcode.HEADER:
            profile = Header.read(_stream(bag, size)).profile
        elif kind == Opcode.CHUNK:
            return profile, chunk_head(bag.body(size))[1]
    return profile, ""


def _stream(bag: McapBag, size: int) -> ReadDataStream:
    return ReadDataStream(BytesIO(bag.body(size)))


class _Copy:
    def __init__(self, bag: McapBag, writer: Writer, editor: Editor) -> None:
        self._bag, self._writer, self._editor = bag, writer, editor
        contents = bag.contents
        schemas = {
            number: writer.register_schema(schema.name, schema.encoding, schema.data)
            for number, schema in sorted(contents.schemas.items())
        }
        self._topics = {number: channel.topic for number, channel in contents.channels.items()}
        self._channels = {
            number: writer.register_channel(
                channel.topic, channel.message_encoding, schemas.get(channel.schema_id, 0), dict(channel.metadata)
            )
            for number, channel in sorted(contents.channels.items())
        }
        self._by_topic = {self._topics[number]: new for number, new in reversed(self._channels.items())}
        for topic in editor.new_topics:
            is_ros1 = topic.encoding == "ros1"
            name, form = (topic.type.replace("/msg/", "/"), "ros1msg") if is_ros1 else (topic.type, "ros2msg")
            schema = writer.register_schema(name, form, topic.definition.encode())
            facts = {} if is_ros1 else {"offered_qos_profiles": topic.qos}
            self._by_topic[topic.name] = writer.register_channel(topic.name, topic.encoding, schema, facts)

    def run(self, on_done: Callable[[float], None]) -> None:
        """Walk over the file."""
        for _, kind, size in self._bag.walk():
            if kind in (Opcode.CHUNK, Opcode.MESSAGE):
                for inner, part in self._bag.records(kind, size):
                    if inner == Opcode.MESSAGE:
                        self._take(part)
            elif kind == Opcode.ATTACHMENT:
                file = Attachment.read(_stream(self._bag, size))
                self._writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
            elif kind == Opcode.METADATA:
                facts = Metadata.read(_stream(self._bag, size))
                self._writer.add_metadata(facts.name, facts.metadata)
            on_done(self._bag.share_read)

    def _take(self, part: memoryview) -> None:
        number, sequence, log_ns, publish_ns = MESSAGE.unpack_from(part)
        if not self._editor.has_begun:
            self._add(self._editor.begin(log_ns))
        message, added = self._editor.take(self._topics.get(number, ""), log_ns, bytes(part[MESSAGE.size :]))
        if number in self._channels:
            self._writer.add_message(self._channels[number], log_ns, message, publish_ns, sequence)
        self._add(added)

    def _add(self, messages: Sequence[Added]) -> None:
        for added in messages:
            self._writer.add_message(self._by_topic[added.topic], added.log_ns, added.data, added.log_ns)
