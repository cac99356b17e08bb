"""The rows of a backup: one SQLite file with the service's own schema, from a database of either kind and back."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Connection, func, insert, select, text

from service.platform.db.migrate import upgrade
from service.platform.db.models import Base
from service.platform.db.session import Database

# What only says how the service is at this moment.
TRANSIENT = frozenset(("heartbeat", "worker", "blob_hold"))
KEPT = tuple(table for table in Base.metadata.sorted_tables if table.name not in TRANSIENT)
_BATCH = 1000


def url_of(file: Path) -> str:
    """The database that a file of rows is."""
    return f"sqlite:///{file}"


def write_rows(source: Connection, file: Path) -> dict[str, int]:
    """Write every row that the connection's snapshot sees into a new file; how many there are by table."""
    upgrade(url_of(file))
    rows = Database(url_of(file))
    try:
        with rows.engine.begin() as target:
            counts = copy_rows(source, target)
        with rows.alone() as connection:
            # All of it in the one file: the write-ahead log goes.
            connection.exec_driver_sql("PRAGMA journal_mode=DELETE")
    finally:
        rows.close()
    return counts


def copy_rows(source: Connection, target: Connection) -> dict[str, int]:
    """Insert all rows of one database into another of the same schema, never holding many of them.

    A row comes after those that it refers to: tables are in that order, and in a table ids grow with time.
    """
    counts: dict[str, int] = {}
    for table in KEPT:
        counts[table.name] = 0
        asked = select(table).order_by(*table.primary_key)
        for rows in source.execution_options(yield_per=_BATCH).execute(asked).mappings().partitions():
            target.execute(insert(table), [dict(row) for row in rows])
            counts[table.name] += len(rows)
        numbered = table.autoincrement_column
        if numbered is not None and counts[table.name] and target.dialect.name == "postgresql":
            # SQLite numbers on after the highest by itself.
            target.execute(
                text("SELECT setval(pg_get_serial_sequence(:table, :column), :highest)"),
                {"table": table.name, "column": numbered.name, "highest": target.scalar(select(func.max(numbered)))},
            )
    return counts
