"""One .db3 file of a ROS 2 bag, row by row into a new one: ids, times and bytes as they are.

The new file's tables are made here, by the columns that rosbag2 knows: nothing of the file's own schema is run.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import zstandard

from workers.readers.copying.editor import Added, Editor, NewTopic
from workers.readers.copying.edits import Edits
from workers.readers.output import declare
from workers.readers.ros.sqlite_bag import SqliteBag, unpacked_message

_TABLES: Final = {
    "schema": "schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL",
    "metadata": "id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL",
    "topics": "id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL, "
    "offered_qos_profiles TEXT NOT NULL, type_description_hash TEXT NOT NULL",
    "message_definitions": "id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL, "
    "encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL",
    "messages": "id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL",
}
_INDEX: Final = "CREATE INDEX timestamp_idx ON messages (timestamp ASC)"
# Of a row: its numbers, their lengths, and its entry in the index.
_ROW_BYTES: Final = 64
_ZSTD: Final = b"\x28\xb5\x2f\xfd"


def copy_sqlite(path: Path, out: Path, edits: Edits, is_first: bool, on_done: Callable[[float], None]) -> Editor:
    """Copy a file. ``is_first``: whether new poses go into it.

    Raises:
        ReadError: as :class:`SqliteBag` and :class:`Editor` do.
    """
    with closing(SqliteBag(path)) as bag:
        editor = Editor(bag, edits)
        with closing(sqlite3.connect(out, isolation_level=None)) as db:
            # Nothing but the new file is written, and a file that was not finished is of no use.
            for pragma in ("journal_mode=OFF", "synchronous=OFF", "temp_store=MEMORY", "cache_size=-4000"):
                db.execute(f"PRAGMA {pragma}")
            db.execute("BEGIN")
            with bag.damage():
                _Copy(bag, db, editor, out.parent).run(is_first, on_done)
            db.execute("COMMIT")
    return editor


class _Copy:
    def __init__(self, bag: SqliteBag, db: sqlite3.Connection, editor: Editor, folder: Path) -> None:
        self._bag, self._db, self._editor, self._folder = bag, db, editor, folder
        self._columns = bag.file.columns
        self._names = {number: name for name, numbers in bag.ids.items() for number in numbers}
        self._ids = {name: numbers[0] for name, numbers in bag.ids.items()}
        self._next_id = 0
        self._is_packed = False

    def run(self, is_first: bool, on_done: Callable[[float], None]) -> None:
        for table in ("schema", "metadata", "topics", "message_definitions"):
            self._copy_table(table)
        for topic in self._editor.new_topics:
            self._add_topic(topic)
        self._make("messages")
        total = max(1, sum(topic.count or 0 for topic in self._bag.topics))
        query = "SELECT id, topic_id, timestamp, data FROM messages WHERE id <= ? ORDER BY id"
        rows = self._bag.file.rows(query, [self._bag.last])
        added: list[Added] = []
        for number, (row, topic_id, log_ns, data) in enumerate(rows):
            self._next_id = max(self._next_id, int(row))
            if number == 0:
                self._is_packed = data[:4] == _ZSTD
                added += self._editor.begin(int(log_ns)) if is_first else []
            name, changed = self._names.get(topic_id, ""), data
            if name in self._editor.watched:
                plain = unpacked_message(data)
                message, beside = self._editor.take(name, int(log_ns), plain)
                added += beside
                if message is not plain:
                    changed = self._packed(message) if data[:4] == _ZSTD else message
            else:
                self._editor.counts.copied += 1
            self._insert(row, topic_id, log_ns, changed)
            on_done(number / total)
        for addition in added:
            self._next_id += 1
            self._insert(self._next_id, self._ids[addition.topic], addition.log_ns, self._packed(addition.data))
        self._db.execute(_INDEX)

    def _packed(self, data: bytes) -> bytes:
        """Of a bag whose recorder packed each message by itself, the new ones too."""
        return zstandard.ZstdCompressor().compress(data) if self._is_packed else data

    def _insert(self, row: int, topic_id: int, log_ns: int, data: bytes) -> None:
        declare(len(data) + _ROW_BYTES, self._folder)
        self._db.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", (row, topic_id, log_ns, data))

    def _make(self, table: str) -> None:
        columns = [column.strip() for column in _TABLES[table].split(",")]
        there = [column for column in columns if column.split()[0] in self._columns.get(table, ())]
        self._db.execute(f"CREATE TABLE {table} ({', '.join(there or columns)})")

    def _copy_table(self, table: str) -> None:
        if table not in self._columns:
            return
        self._make(table)
        names = [part.split()[0] for part in _TABLES[table].split(",") if part.split()[0] in self._columns[table]]
        rows: Iterable[tuple[Any, ...]] = self._bag.file.rows(f"SELECT {', '.join(names)} FROM {table}")
        for row in rows:
            self._insert_into(table, dict(zip(names, row, strict=True)))

    def _add_topic(self, topic: NewTopic) -> None:
        number = max([0, *self._names]) + 1
        self._names[number], self._ids[topic.name] = topic.name, number
        self._insert_into("topics", {"id": number, **topic.metadata})
        if "message_definitions" in self._columns:
            values = {
                "topic_type": topic.type,
                "encoding": "ros2msg",
                "encoded_message_definition": topic.definition,
                "type_description_hash": topic.metadata["type_description_hash"],
            }
            self._insert_into("message_definitions", values)

    def _insert_into(self, table: str, values: Mapping[str, Any]) -> None:
        """A row, of which the table takes what it has columns for."""
        names = [name for name in values if name in self._columns[table]]
        declare(
            _ROW_BYTES + sum(len(cell) for cell in values.values() if isinstance(cell, str | bytes)), self._folder
        )
        marks = ", ".join("?" * len(names))
        row = [values[name] for name in names]
        self._db.execute(f"INSERT INTO {table} ({', '.join(names)}) VALUES ({marks})", row)
