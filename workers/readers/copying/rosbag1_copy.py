"""A ROS 1 bag, message by message into a new one: connections, times and bytes as they are."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO, Final, cast

from rosbags.interfaces import Connection, ConnectionExtRosbag1
from rosbags.rosbag1 import Writer

from workers.readers.copying.editor import Added, Editor, NewTopic
from workers.readers.copying.edits import EditCounts, Edits
from workers.readers.output import create
from workers.readers.ros.ros_types import fixed_types
from workers.readers.ros.rosbag1 import Rosbag1Bag

_LATCHED: Final = 1


class _Place:
    """A path that opens a file whose bytes count."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def open(self, mode: str) -> BinaryIO:
        assert mode == "xb"
        return create(self._path)


def copy_rosbag1(path: Path, out: Path, edits: Edits, on_done: Callable[[float], None]) -> EditCounts:
    """Raises :class:`ReadError` as :class:`Rosbag1Bag` and :class:`Editor` do."""
    with closing(Rosbag1Bag(path)) as bag:
        editor = Editor(bag, edits)
        with bag.damage():
            _copy(bag, out, editor, on_done)
        editor.check_complete()
    return editor.counts


def _copy(bag: Rosbag1Bag, out: Path, editor: Editor, on_done: Callable[[float], None]) -> None:
    writer = Writer(out)
    writer.path = cast(Any, _Place(out))
    if bag.reader.compression in ("bz2", "lz4"):
        writer.set_compression(Writer.CompressionFormat[bag.reader.compression.upper()])
    total = max(1, sum(connection.msgcount for connection in bag.reader.connections))
    with writer:
        connections = _connections(bag, writer)
        new = {topic.name: _add(writer, topic) for topic in editor.new_topics}
        by_topic = {connection.topic: connection for connection in connections.values()} | new

        def add(added: list[Added]) -> None:
            for extra in added:
                writer.write(by_topic[extra.topic], extra.log_ns, extra.data)

        for number, (connection, log_ns, raw) in enumerate(bag.reader.messages()):
            if number == 0:
                add(editor.begin(log_ns))
            message, added = editor.take(connection.topic, log_ns, raw)
            writer.write(connections[connection.id], log_ns, message)
            add(added)
            on_done(number / total)


def _connections(bag: Rosbag1Bag, writer: Writer) -> dict[int, Connection]:
    """Return the writer's connections by their number in the bag. Equal ones are one connection."""
    by_identity: dict[tuple[Any, ...], Connection] = {}
    by_id: dict[int, Connection] = {}
    for source in bag.reader.connections:
        ext = cast(ConnectionExtRosbag1, source.ext)
        identity = (source.topic, source.msgtype, source.msgdef.data, source.digest, ext.callerid, ext.latching)
        if identity not in by_identity:
            by_identity[identity] = writer.add_connection(
                source.topic,
                source.msgtype,
                msgdef=source.msgdef.data,
                md5sum=source.digest,
                callerid=ext.callerid,
                latching=ext.latching,
            )
        by_id[source.id] = by_identity[identity]
    return by_id


def _add(writer: Writer, topic: NewTopic) -> Connection:
    latching = _LATCHED if topic.latched else None
    return writer.add_connection(topic.name, topic.type, typestore=fixed_types("ros1"), latching=latching)
