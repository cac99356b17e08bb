"""What the product's own functions ask of a database: each statement's plan, and how much of the tables it touches.

PostgreSQL explains each statement with what it really did, in a transaction that is taken back, just before the
product runs it. SQLite says which tables it scans, and counts its machine's steps meanwhile.
"""

from __future__ import annotations

import json
import re
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import event

from service.platform.db.session import Database

_EXPLAINED = ("SELECT", "UPDATE", "DELETE", "INSERT", "WITH")


@dataclass
class Touched:
    """One function's statements: those that scan a table whole, and what all of them touched.

    ``rows`` and ``pages`` on PostgreSQL: read from tables and indexes, also those that a filter dropped. ``steps`` on
    SQLite: of its virtual machine, a handful for each row.
    """

    scans: list[str] = field(default_factory=list)
    statements: list[str] = field(default_factory=list)
    rows: int = 0
    pages: int = 0
    steps: int = 0


@contextmanager
def touched(database: Database) -> Iterator[Touched]:
    """What is asked of the database meanwhile."""
    found = Touched()
    look = _look_at_sqlite if database.engine.dialect.name == "sqlite" else _look_at_postgresql

    def before(connection: Any, cursor: Any, statement: str, parameters: Any, context: Any, many: bool) -> None:
        if statement.startswith(_EXPLAINED) and not many:
            found.statements.append(statement)
            look(connection.connection.driver_connection, statement, parameters, found)

    event.listen(database.engine, "before_cursor_execute", before)
    try:
        yield found
    finally:
        event.remove(database.engine, "before_cursor_execute", before)
        if database.engine.dialect.name == "sqlite":
            _stop_counting(database)


_STEPS = 10


def _look_at_sqlite(connection: sqlite3.Connection, statement: str, parameters: Any, found: Touched) -> None:
    connection.set_progress_handler(None, _STEPS)
    for _, _, _, line in connection.execute(f"EXPLAIN QUERY PLAN {statement}", parameters):
        scanned = re.match(r"SCAN (\w+)(?!.*VIRTUAL)", line)
        if scanned:
            found.scans.append(f"{line}: {statement}")

    def count() -> int:
        found.steps += _STEPS
        return 0

    connection.set_progress_handler(count, _STEPS)


def _stop_counting(database: Database) -> None:
    with database.engine.connect() as connection:
        driver: Any = connection.connection.driver_connection
        driver.set_progress_handler(None, _STEPS)


def _look_at_postgresql(connection: Any, statement: str, parameters: Any, found: Touched) -> None:
    with connection.cursor() as cursor:
        if connection.autocommit:
            cursor.execute("BEGIN")
        cursor.execute("SAVEPOINT looked")
        cursor.execute(f"EXPLAIN (ANALYZE, BUFFERS, FORMAT JSON) {statement}", parameters)
        (plan,) = cursor.fetchone()
        cursor.execute("ROLLBACK TO SAVEPOINT looked")
        if connection.autocommit:
            cursor.execute("ROLLBACK")
    document = plan if isinstance(plan, list) else json.loads(plan)
    top = document[0]["Plan"]
    found.pages += top["Shared Hit Blocks"] + top["Shared Read Blocks"]
    _add(top, statement, found)


def _add(node: dict[str, Any], statement: str, found: Touched) -> None:
    if "Relation Name" in node or "Index Name" in node:
        loops = node.get("Actual Loops", 0)
        dropped = sum(node.get(name, 0) for name in ("Rows Removed by Filter", "Rows Removed by Index Recheck"))
        found.rows += round(loops * (node.get("Actual Rows", 0) + dropped))
        if node["Node Type"] == "Seq Scan":
            found.scans.append(f"{node['Relation Name']}: {statement}")
    for child in node.get("Plans", []):
        _add(child, statement, found)
