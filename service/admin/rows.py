"""Tables as files: a gzipped line of JSON for each row, the same from SQLite and from PostgreSQL.

A file is described by its columns' names and types, so that it is read without the models that wrote it.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Connection,
    Double,
    Float,
    Integer,
    String,
    Table,
    Uuid,
    insert,
    select,
)
from sqlalchemy import column as light_column
from sqlalchemy import table as light_table
from sqlalchemy.types import TypeEngine

from service.admin.errors import AdminError
from service.platform.db.base import Finite
from service.platform.db.clock import Instant

_BATCH = 1000
_SQUEEZE = 3  # gzip's level: the rows are small beside the blobs, and what takes long is not done often


class _Kind(NamedTuple):
    type: Callable[[], TypeEngine[Any]]
    write: Callable[[Any], Any]
    read: Callable[[Any], Any]


def _same(value: Any) -> Any:
    return value


_INSTANT = Instant()
_KINDS: dict[str, _Kind] = {
    "uuid": _Kind(Uuid, lambda value: value.hex, UUID),
    # Whole microseconds since 1970, as both databases hold it.
    "instant": _Kind(Instant, lambda value: _INSTANT.process_bind_param(value, None), lambda value: _instant(value)),  # pyright: ignore[reportArgumentType]
    "json": _Kind(lambda: JSON(none_as_null=True), _same, _same),
    "bool": _Kind(Boolean, bool, bool),
    "int": _Kind(BigInteger, int, int),
    "float": _Kind(Double, float, float),
    "text": _Kind(String, str, str),
}


def _instant(value: int) -> datetime | None:
    return _INSTANT.process_result_value(value, None)  # pyright: ignore[reportArgumentType]


def kind_of(column: Column[Any]) -> str:
    """The name under which a column's type is written. Raises TypeError for one that backups do not know."""
    for name, classes in (
        ("instant", (Instant,)),
        ("uuid", (Uuid,)),
        ("json", (JSON,)),
        ("bool", (Boolean,)),
        ("float", (Finite, Float, Double)),
        ("int", (Integer, BigInteger)),
        ("text", (String,)),
    ):
        if isinstance(column.type, classes):
            return name
    raise TypeError(f"{column}: backups do not know {column.type!r}")


class TableFile(NamedTuple):
    """A written table. ``sha256`` is of the file."""

    name: str
    columns: list[tuple[str, str]]
    rows: int
    sha256: str


def write_table(connection: Connection, table: Table, path: Path) -> TableFile:
    """Write every row that the connection's snapshot sees, never holding many of them."""
    columns = [(column.name, kind_of(column)) for column in table.columns]
    encode = [_KINDS[kind].write for _, kind in columns]
    found = connection.execution_options(yield_per=_BATCH).execute(select(table))
    count = 0
    with gzip.open(path, "wt", compresslevel=_SQUEEZE, encoding="utf-8") as file:
        for row in found:
            values = [None if value is None else write(value) for write, value in zip(encode, row, strict=True)]
            file.write(json.dumps(values, allow_nan=False, separators=(",", ":")) + "\n")
            count += 1
    return TableFile(table.name, columns, count, digest(path))


def read_table(connection: Connection, written: TableFile, path: Path) -> int:
    """Insert a file's rows, and return how many they were."""
    put = _copied if connection.dialect.name == "postgresql" else _inserted
    with gzip.open(path, "rt", encoding="utf-8") as file:
        return put(connection, written, file)


def _copied(connection: Connection, written: TableFile, lines: Iterable[str]) -> int:
    """Rows by COPY, which takes the values as the file has them, but for JSON: that is text within the text."""
    quoted = connection.dialect.identifier_preparer.quote
    columns = ", ".join(quoted(name) for name, _ in written.columns)
    documents = [number for number, (_, kind) in enumerate(written.columns) if kind == "json"]
    cursor: Any = connection.connection.cursor()
    count = 0
    try:
        with cursor, cursor.copy(f"COPY {quoted(written.name)} ({columns}) FROM STDIN") as copy:
            for line in lines:
                values: list[Any] = json.loads(line)
                for number in documents:
                    if values[number] is not None:
                        values[number] = json.dumps(values[number])
                copy.write_row(values)
                count += 1
    except connection.dialect.loaded_dbapi.Error as error:  # which passed SQLAlchemy by
        said = str(error).partition("\n")[0]
        raise AdminError(f"PostgreSQL refuses the rows of {written.name}: {said}", "No row was restored.") from error
    return count


def _inserted(connection: Connection, written: TableFile, lines: Iterable[str]) -> int:
    kinds = [_KINDS[kind] for _, kind in written.columns]
    names = [name for name, _ in written.columns]
    target = light_table(
        written.name, *(light_column(name, kind.type()) for name, kind in zip(names, kinds, strict=True))
    )
    decode = [kind.read for kind in kinds]
    rest = iter(lines)
    count = 0
    while batch := [_decoded(names, decode, line) for line in islice(rest, _BATCH)]:
        connection.execute(insert(target), batch)
        count += len(batch)
    return count


def _decoded(names: list[str], decode: list[Callable[[Any], Any]], line: str) -> dict[str, Any]:
    values: list[Any] = json.loads(line)
    return {
        name: None if value is None else read(value) for name, read, value in zip(names, decode, values, strict=True)
    }


def lines_of(path: Path) -> Iterator[dict[str, Any]]:
    """The objects of a plain file of JSON lines."""
    with path.open(encoding="utf-8") as file:
        yield from map(json.loads, file)


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
