"""The SQLite files of ROS 2 bags (.db3), in the order in which messages were recorded."""

from __future__ import annotations

import sqlite3
from array import array
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final

import numpy as np
import zstandard
from numpy.typing import NDArray
from rosbags.serde import SerdeError

from workers.readers.bounded import decompress_zstd
from workers.readers.damage import damage, on_error
from workers.readers.recording import ReadError
from workers.readers.ros.containers import Container, spread
from workers.readers.ros.sqlite_file import MAX_VALUE_BYTES, SqliteFile
from workers.readers.ros.topic_messages import BagTopic

_ZSTD: Final = b"\x28\xb5\x2f\xfd"
_TIMES: Final = 2000
_MAX_ID: Final = 2**63 - 1
_HINT: Final = "Copy or upload the bag again; `sqlite3 FILE .recover` may save what is left of a damaged one."


class SqliteBag(Container):
    """One .db3 file.

    Raises:
        ReadError: ``recording_damaged``, ``not_a_recording``, ``sqlite_not_plain``.
    """

    format = "rosbag2_sqlite3"

    def __init__(self, path: Path) -> None:
        self._path = path
        self.warnings = []
        self.size = path.stat().st_size
        with self.damage():
            self.file = SqliteFile(path)
        if self.file.log:
            self.warnings.append(f"{self.file.log} was read with {path.name}: recording was interrupted.")
        with on_error(self.file.close), self.damage():
            self.ids, self.topics = self._read_topics()

    def damage(self) -> AbstractContextManager[None]:
        """Turn the errors that libraries raise on damaged bytes into ``recording_damaged``."""
        kinds = (sqlite3.Error, SerdeError, zstandard.ZstdError)
        return damage(self._path.name, "a ROS 2 bag in SQLite", _HINT, *kinds)

    def _read_topics(self) -> tuple[dict[str, list[int]], list[BagTopic]]:
        if not {"topics", "messages"} <= self.file.columns.keys():
            raise ReadError(
                "not_a_recording",
                f"{self._path.name} is an SQLite file without the tables of a ROS 2 bag.",
                "Upload the .db3 file that `ros2 bag record` wrote.",
            )
        definitions: dict[str, tuple[str, str]] = {}
        if "message_definitions" in self.file.columns:
            rows = self.file.rows("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
            definitions = {str(kind): (str(text), str(form)) for kind, form, text in rows}
        self.last = self._last_whole() if self.file.is_cut else _MAX_ID
        some = "SELECT topic_id FROM messages WHERE id <= ? LIMIT ?"  # a table whose pages lie in a circle has no end
        most = self.file.most_rows
        counts: dict[int, int] = dict(
            self.file.rows(f"SELECT topic_id, count(*) FROM ({some}) GROUP BY topic_id", [self.last, most])
        )
        if sum(counts.values()) >= most:
            raise sqlite3.DatabaseError("it has more messages than room for them")
        ids: dict[str, list[int]] = {}
        topics: list[BagTopic] = []
        there = self.file.columns["topics"]
        more = [name if name in there else "''" for name in ("offered_qos_profiles", "type_description_hash")]
        rows = self.file.rows(
            f"SELECT id, name, type, serialization_format, {', '.join(more)} FROM topics ORDER BY id"
        )
        for number, name, kind, encoding, qos, type_hash in rows:
            ids.setdefault(str(name), []).append(int(number))
            if len(ids[name]) == 1:
                text, form = definitions.get(str(kind), ("", ""))
                usual = str(encoding) or "cdr"  # old recorders left it empty; there is no other format in ROS 2
                facts = (str(name), str(kind), usual, text, form, counts.get(number, 0))
                topics.append(BagTopic(*facts, qos=str(qos), type_hash=str(type_hash)))
        return ids, topics

    def _last_whole(self) -> int:
        """The id of the last message that is whole for certain, of a file that was cut short.

        SQLite fills the last page with zeros, and messages were written in the order of their ids. So the page may
        belong to the last message that is not shorter than a page, or to those behind it.
        """
        ids, sizes = array("q"), array("q")
        try:
            for number, data in self.file.rows("SELECT id, data FROM messages ORDER BY id"):
                if not isinstance(data, bytes) or (ids and number <= ids[-1]):
                    break
                ids.append(number)
                sizes.append(len(data))
        except sqlite3.OperationalError:  # it took too long
            raise
        except sqlite3.DatabaseError:
            pass
        doubtful = 0
        while ids and doubtful <= self.file.page_bytes:
            doubtful += sizes.pop()
            ids.pop()
        self.warnings.append(
            f"{self._path.name} is cut short, as when recording is interrupted; {len(ids)} messages were read."
        )
        return ids[-1] if ids else 0

    def _rows(self, columns: str, names: Collection[str], end: str = "") -> Iterator[tuple[Any, ...]]:
        """Yield rows of these topics' messages in recorded order, which is the order of their ids."""
        numbers = [number for name in names for number in self.ids[name]]
        marks = ",".join("?" * len(numbers))
        query = f"SELECT {columns} FROM messages WHERE topic_id IN ({marks}) AND id <= ? ORDER BY id {end}"
        with self.damage():
            yield from self.file.rows(query, [*numbers, self.last])

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """See :class:`Container`."""
        by_id = {number: name for name in names for number in self.ids[name]}
        with self.damage():
            for topic_id, log_ns, data in self._rows("topic_id, timestamp, data", names):
                yield by_id[topic_id], int(log_ns), unpacked_message(data)

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """See :class:`Container`."""
        ids = array("q", (number for (number,) in self._rows("id", [name])))
        with self.damage():
            for number in spread(ids, count):
                query = "SELECT timestamp, data FROM messages WHERE id = ? LIMIT 1"
                ((log_ns, data),) = self.file.rows(query, [number])
                yield int(log_ns), unpacked_message(data)

    def times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        return self._times(name, f"LIMIT {_TIMES}")

    def log_times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        return self._times(name, "")

    def _times(self, name: str, limit: str) -> NDArray[np.int64]:
        with self.damage():
            return np.fromiter((time for (time,) in self._rows("timestamp", [name], limit)), np.int64)

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def unpacked_message(data: bytes) -> bytes:
    """A message, decompressed where the recorder packed each by itself; CDR never begins with zstd's magic."""
    if data[:4] == _ZSTD:
        return decompress_zstd(data, MAX_VALUE_BYTES)
    return data
