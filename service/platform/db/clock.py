"""Time stamps of rows, and the database's own clock.

Leases, expiry and the order of rows in time go by the database's clock alone, so workers whose clocks differ agree on
who holds a job. PostgreSQL gives microseconds, SQLite milliseconds.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from sqlalchemy import BigInteger, Dialect, bindparam, select, type_coerce
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.expression import ColumnElement, FunctionElement
from sqlalchemy.types import TypeDecorator

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class Instant(TypeDecorator[datetime]):
    """An aware UTC datetime, stored as integer microseconds since 1970 on both databases."""

    impl = BigInteger
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> int | None:
        if value is None:
            return None
        delta = value - _EPOCH
        return (delta.days * 86_400 + delta.seconds) * 1_000_000 + delta.microseconds

    def process_result_value(self, value: Any | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        seconds, micros = divmod(int(value), 1_000_000)
        return datetime.fromtimestamp(seconds, UTC).replace(microsecond=micros)


class _Seconds(TypeDecorator[float]):
    """Seconds, bound as integer microseconds."""

    impl = BigInteger
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> int:
        return round((value or 0.0) * 1e6)


class _clock(FunctionElement[int]):  # noqa: N801 - SQLAlchemy names functions so
    inherit_cache = True
    type = BigInteger()


@compiles(_clock, "sqlite")
def _sqlite_clock(element: _clock, compiler: Any, **kw: Any) -> str:
    # SQLite before 3.42 has no unixepoch('subsec'); julianday resolves a millisecond.
    return "(CAST(round((julianday('now') - 2440587.5) * 86400000) AS INTEGER) * 1000)"


@compiles(_clock, "postgresql")
def _postgresql_clock(element: _clock, compiler: Any, **kw: Any) -> str:
    # now() is when the transaction began; after a wait for a lock it would make rows older than they are.
    # As a query of its own it is evaluated once, so that an index can be searched by it.
    return "(SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000000 AS BIGINT))"


def now(plus_s: float = 0.0) -> ColumnElement[datetime]:
    """The database's own clock plus ``plus_s`` seconds, as an SQL expression."""
    return type_coerce(_clock() + round(plus_s * 1e6), Instant())


def now_plus(name: str) -> ColumnElement[datetime]:
    """The database's own clock plus the seconds that an execution gives as ``name``, for statements built once."""
    return type_coerce(_clock() + bindparam(name, type_=_Seconds()), Instant())


def moment(session: Session) -> datetime:
    """Return the time by the database's clock, to be stored and answered."""
    return session.scalars(select(now())).one()


def utc_now() -> datetime:
    """This process's clock: for what is only shown, and for what this process compares with itself."""
    return datetime.now(UTC)
