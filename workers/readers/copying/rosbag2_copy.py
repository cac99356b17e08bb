"""A ROS 2 bag, message by message into a new one of one file, which the library rosbags writes."""

from __future__ import annotations

import shutil
import tarfile
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Final, Literal

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, ReaderError, StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from workers.readers.copying.editor import Added, Editor, NewTopic
from workers.readers.copying.edits import EditCounts, Edits
from workers.readers.damage import damage
from workers.readers.output import create, declare
from workers.readers.ros.containers import Container
from workers.readers.ros.ros_types import fixed_types
from workers.readers.ros.rosbag2 import METADATA, open_bag, read_metadata
from workers.readers.ros.topic_messages import BagTopic

# Of a row: its numbers, their lengths, and its entry in the index.
_ROW_BYTES: Final = 64
_NO_HASH: Final = "RIHS01_" + 64 * "0"
# From it on quality of service is a list; older programs read a text.
_WITH_LISTS: Final = 9


def copy_rosbag2(path: Path, out: Path, edits: Edits, on_done: Callable[[float], None]) -> tuple[Path, EditCounts]:
    """Copy a bag's file to one of its format, a bag's folder to a tar. Returns where it is, and what was done.

    Raises:
        ReadError: as the bag's reader and :class:`Editor` do.
    """
    folder = out.parent / "bag"
    try:
        counts = _copied(path, folder, edits, on_done)
        if path.is_dir():
            copy = out.with_name(f"{out.name}.tar")
            with create(copy) as raw, tarfile.open(fileobj=raw, mode="w") as tar:
                tar.add(folder, arcname=folder.name)
        else:
            copy = out.with_name(f"{out.name}.db3")
            (folder / f"{folder.name}.db3").rename(copy)
        return copy, counts
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _copied(path: Path, folder: Path, edits: Edits, on_done: Callable[[float], None]) -> EditCounts:
    """Write a bag's folder."""
    with closing(open_bag(path)) as bag:
        is_mcap = bag.format == "mcap"
        editor = Editor(bag, edits)
        version: Literal[8, 9] = 8
        if path.is_dir() and read_metadata(path / METADATA).get("version") == _WITH_LISTS:
            version = 9
        writer = Writer(
            folder, version=version, storage_plugin=StoragePlugin.MCAP if is_mcap else StoragePlugin.SQLITE3
        )
        if is_mcap:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with bag.damage(), writer:
            _Copy(bag, writer, editor).run(on_done)
    editor.check_complete()
    return editor.counts


class _Copy:
    def __init__(self, bag: Container, writer: Writer, editor: Editor) -> None:
        self._bag, self._writer, self._editor = bag, writer, editor
        self._topics: dict[str, BagTopic | NewTopic] = {
            topic.name: topic for topic in (*editor.new_topics, *bag.topics)
        }
        self._connections: dict[str, Connection] = {}

    def run(self, on_done: Callable[[float], None]) -> None:
        total = max(1, sum(topic.count or 0 for topic in self._bag.topics))
        names = [topic.name for topic in self._bag.topics]
        for number, (topic, log_ns, raw) in enumerate(self._bag.messages(names)):
            if not self._editor.has_begun:
                self._add(self._editor.begin(log_ns))
            message, added = self._editor.take(topic, log_ns, raw)
            self._add([Added(topic, log_ns, message), *added])
            on_done(min(1.0, number / total))

    def _add(self, messages: Sequence[Added]) -> None:
        for message in messages:
            if message.topic not in self._connections:
                self._connections[message.topic] = self._connection(self._topics[message.topic])
            declare(len(message.data) + _ROW_BYTES, self._writer.path)
            self._writer.write(self._connections[message.topic], message.log_ns, message.data)

    def _connection(self, topic: BagTopic | NewTopic) -> Connection:
        with damage(topic.name, "a topic's quality of service", "Run `ros2 bag reindex` on the bag.", ReaderError):
            qos = parse_qos(topic.qos)
        return self._writer.add_connection(
            topic.name,
            topic.type,
            msgdef=topic.definition,
            rihs01=topic.type_hash or _hash_of(topic),
            serialization_format=topic.encoding,
            offered_qos_profiles=qos,
        )


def _hash_of(topic: BagTopic | NewTopic) -> str:
    """The hash of a type whose bag states none: as ROS 2 defines it, or by its definition; else zeros."""
    types = fixed_types("cdr")
    try:
        if topic.type not in types.types:
            types = get_typestore(Stores.EMPTY)
            types.register(get_types_from_msg(topic.definition, topic.type))
        return types.hash_rihs01(topic.type)
    except (TypesysError, KeyError):
        return _NO_HASH
