"""An SQLite file from a stranger: only ordinary tables are read, and no query goes on without end.

What a schema says is run by whoever reads: a view, a generated column or a virtual table is a program of the file's
owner. Pages may name each other in a circle, and rows may share their pages. So the schema is looked at before any
table is, queries end by a deadline, and no more is taken out of a file than it has bytes.

A recorder that was interrupted leaves messages in a write-ahead log beside the file. SQLite reads both from copies in
a scratch folder, because it writes an index of the log beside them.
"""

from __future__ import annotations

import re
import sqlite3
import struct
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from workers.readers.damage import on_error
from workers.readers.progress import beat
from workers.readers.recording import ReadError
from workers.readers.trees.scratch import Scratch

MAX_VALUE_BYTES: Final = 256 * 1024**2
# Processor time from one row to the next: counting two million messages took 0.39 s, and nothing else takes longer.
QUERY_CPU_S: Final = 20.0
_STEPS: Final = 10_000  # of SQLite's machine between two looks at the time: 0.1 ms
# A row of a message takes more than this: its number, its topic, its time, and the lengths of these.
_ROW_BYTES: Final = 8
_MAX_OBJECTS: Final = 1000
_ORDINARY: Final = re.compile(r"\s*CREATE\s+(TABLE|(UNIQUE\s+)?INDEX)\b", re.IGNORECASE)
# What plain queries of ordinary tables need; a schema is text from the file, and is parsed with these limits too.
_LIMITS: Final = {
    sqlite3.SQLITE_LIMIT_LENGTH: MAX_VALUE_BYTES,
    sqlite3.SQLITE_LIMIT_SQL_LENGTH: 1_000_000,
    sqlite3.SQLITE_LIMIT_COLUMN: 100,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 50,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 2,
    sqlite3.SQLITE_LIMIT_FUNCTION_ARG: 8,
    sqlite3.SQLITE_LIMIT_ATTACHED: 0,
    sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH: 1,
    sqlite3.SQLITE_LIMIT_WORKER_THREADS: 0,
}
_FUNCTIONS: Final = frozenset({"count"})
_ALLOWED: Final = frozenset({sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ})


class SqliteFile:
    """Reads rows of ordinary tables.

    Attributes:
        columns: of each table that may be read, the names of its columns.
        most_rows: more than this the file has no room for.
        page_bytes: size of a page.
        is_cut: whether the file ends before its last page does. SQLite reads zeros for what is missing of a page.
        log: name of the write-ahead log that is read with the file, empty where there is none.

    Raises:
        ReadError: ``sqlite_not_plain``, the file holds views, triggers or virtual tables.
        sqlite3.Error: it is damaged, or a query took too long.
    """

    def __init__(self, path: Path) -> None:
        self._name = path.name
        self._scratch = Scratch(path.name)
        log = log_of(path)
        self.log = log.name if log else ""
        self._size = path.stat().st_size + (log.stat().st_size if log else 0)
        self.most_rows = self._size // _ROW_BYTES + 1
        self._since = time.process_time()
        self._late = False
        self.page_bytes, pages = _pages(path)
        # With a log the number of pages in the file's head may be an older one.
        self.is_cut = not log and (self._size < pages * self.page_bytes or self._size % self.page_bytes != 0)
        with on_error(self._scratch.close):
            if log:
                path, log = self._copied(path), self._copied(log)
            uri = f"{path.absolute().as_uri()}?mode=ro{'' if log else '&immutable=1'}"
            self._db = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
        with on_error(self.close):
            for limit, value in _LIMITS.items():
                self._db.setlimit(limit, value)
            self._db.set_progress_handler(self._overdue, _STEPS)
            # Nothing is spilled into files: what is written is counted, and memory has a limit of its own.
            memory = ("cache_size=-4000", "temp_store=MEMORY")
            # Without it SQLite opens no file that lacks a page.
            cut = ("writable_schema=ON",) if self.is_cut else ()
            for pragma in (*cut, "trusted_schema=OFF", "cell_size_check=ON", "query_only=ON", *memory):
                self._db.execute(f"PRAGMA {pragma}")
            self.columns = self._ordinary_tables()
        self._db.set_authorizer(_permitted)

    def _copied(self, file: Path) -> Path:
        with file.open("rb") as stream:
            return self._scratch.write(stream, file.name)

    def _overdue(self) -> bool:
        beat()
        self._late = time.process_time() - self._since > QUERY_CPU_S
        return self._late

    def _ordinary_tables(self) -> dict[str, frozenset[str]]:
        objects = self._db.execute(f"SELECT name, sql FROM sqlite_master LIMIT {_MAX_OBJECTS + 1}").fetchall()
        if len(objects) > _MAX_OBJECTS:
            raise self._refused(f"more than {_MAX_OBJECTS} tables")
        # The type that the schema states is no more than a word; SQLite goes by the statement. Those without one
        # are indexes that SQLite makes by itself.
        if any(sql is not None and not _ORDINARY.match(str(sql)) for _, sql in objects):
            raise self._refused("a view, a trigger or a virtual table")
        tables = frozenset(str(name).lower() for name, sql in objects if sql is not None and _is_table(str(sql)))
        columns_of: dict[str, frozenset[str]] = {}
        for name in tables:
            columns = self._db.execute("SELECT name, hidden FROM pragma_table_xinfo(?)", [name]).fetchall()
            if any(hidden for _, hidden in columns):
                raise self._refused("a generated column")
            columns_of[name] = frozenset(str(column) for column, _ in columns)
        return columns_of

    def _refused(self, what: str) -> ReadError:
        return ReadError(
            "sqlite_not_plain",
            f"{self._name} was refused: it has {what}, which no recorder writes.",
            "Upload the .db3 file as `ros2 bag record` wrote it, or convert it to MCAP with `ros2 bag convert`.",
        )

    def rows(self, query: str, values: Sequence[object] = ()) -> Iterator[tuple[Any, ...]]:
        """The rows of a query.

        Raises:
            sqlite3.Error: the file is damaged, it took too long to find one, or there are more rows, or more bytes in
                them, than the file has room for.
        """
        taken = 0
        self._since = time.process_time()
        try:
            for number, row in enumerate(self._db.execute(query, values)):
                taken += sum(len(value) for value in row if isinstance(value, bytes | str))
                if number > self.most_rows or taken > self._size:
                    raise sqlite3.DatabaseError("its tables hold more than the file has bytes")
                yield row
                self._since = time.process_time()
        except sqlite3.OperationalError as error:
            if self._late:
                raise sqlite3.OperationalError(f"a query took more than {QUERY_CPU_S:.0f} s") from error
            raise

    def close(self) -> None:
        """Close the file, and remove its copy."""
        self._db.close()
        self._scratch.close()


def log_of(path: Path) -> Path | None:
    """The write-ahead log beside an SQLite file, if it holds anything."""
    log = path.with_name(f"{path.name}-wal")
    return log if log.is_file() and not log.is_symlink() and log.stat().st_size else None


def _pages(path: Path) -> tuple[int, int]:
    """Bytes of a page and number of pages, as the file's head states them (sqlite.org/fileformat.html, 1.3)."""
    with path.open("rb") as file:
        head = file.read(32).ljust(32, b"\0")
    (size, pages) = struct.unpack_from(">H10xI", head, 16)
    return {0: 512, 1: 65_536}.get(size, size), pages


def _is_table(sql: str) -> bool:
    match = _ORDINARY.match(sql)
    return match is not None and match.group(1).upper() == "TABLE"


def _permitted(action: int, first: str | None, second: str | None, database: str | None, inner: str | None) -> int:
    """Queries that read columns and count; no function, no pragma, nothing recursive, no other file."""
    counts = action == sqlite3.SQLITE_FUNCTION and second in _FUNCTIONS
    return sqlite3.SQLITE_OK if counts or action in _ALLOWED else sqlite3.SQLITE_DENY
