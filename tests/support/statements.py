"""Statements compiled once a test process, as in a service, though the tests open over a thousand engines.

SQLAlchemy keeps a compiled statement under its dialect, and each engine has a dialect of its own. Two dialects of one
class that were opened with the same settings compile alike.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from sqlalchemy import create_engine
from sqlalchemy.dialects.postgresql.psycopg import PGDialect_psycopg
from sqlalchemy.dialects.sqlite.pysqlite import SQLiteDialect_pysqlite

from service.platform.db import session


def compile_once() -> None:
    """Let all engines of :mod:`service.platform.db.session` share what was compiled."""
    compiled: dict[Any, Any] = {}
    for dialect in (PGDialect_psycopg, SQLiteDialect_pysqlite):
        dialect.__eq__ = _alike  # type: ignore[method-assign]
        dialect.__hash__ = _of_class  # type: ignore[method-assign]
    session.create_engine = partial(create_engine, execution_options={"compiled_cache": compiled})


def _alike(one: Any, other: object) -> bool:
    return type(one) is type(other)


def _of_class(one: Any) -> int:
    return hash(type(one))
