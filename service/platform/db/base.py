"""The ground of all tables: the declarative base, column types and the columns that most rows have.

Ids of rows that the outside sees are random, and sorted by the time they were made (RFC 9562). One content has one
hash: that of its canonical JSON, the same on every machine.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Iterator
from contextvars import ContextVar
from datetime import datetime
from math import isfinite
from typing import Annotated, Any, ClassVar, TypeVar
from uuid import UUID

from sqlalchemy import (
    JSON,
    BigInteger,
    ColumnElement,
    Dialect,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Uuid,
    inspect,
    literal_column,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, aliased, declared_attr, mapped_column
from sqlalchemy.types import TypeDecorator

from apexcal.documents.corners import TOP
from apexcal.documents.states import WorkState
from service.platform.db.clock import Instant, now


def new_id() -> UUID:
    """A UUID version 7: 48 bits of Unix milliseconds, 12 of their fraction, then 62 random bits.

    With the fraction (RFC 9562, section 6.2, method 3) rows that one process makes one after the other sort so.
    """
    stamp, within = divmod(time.time_ns(), 1_000_000)
    head = (stamp & (1 << 48) - 1) << 80 | 0x7 << 76 | (within << 12) // 1_000_000 << 64
    return UUID(int=head | 0x2 << 62 | int.from_bytes(os.urandom(8), "big") >> 2)


def content_hash(content: Any) -> str:
    """SHA-256 of a JSON value in hexadecimal: members sorted, no spaces, floats in their shortest exact form.

    Raises:
        ValueError: a number is not finite.
    """
    digest = hashlib.sha256()
    for piece in _canonical(content):
        digest.update(piece.encode())
    return digest.hexdigest()


def _canonical(content: Any) -> Iterator[str]:
    # Member by member: others have the interpreter between two columns of 100,000 numbers.
    if isinstance(content, dict) and content and all(isinstance(name, str) for name in content):
        for number, name in enumerate(sorted(content)):
            yield f"{',' if number else '{'}{json.dumps(name)}:"
            yield from _canonical(content[name])
        yield "}"
    else:
        yield json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


# Bytes that a call may have of rows with many pairs. None: nobody counts, as in workers and upkeep.
BYTES_IN_HAND: ContextVar[int | None] = ContextVar("bytes_in_hand", default=None)
# What every call may have: some 12,000 pairs.
LIGHT_BYTES = 8 * 1024**2
# A pair with ten columns, as objects of Python.
PAIR_BYTES = 700


class TooHeavyError(Exception):
    """The call is to be made again, where it may have ``size`` bytes."""

    def __init__(self, size: int) -> None:
        self.size = size
        super().__init__(size)


def require_memory(pairs: int) -> None:
    """Raise :class:`TooHeavyError` if so many pairs need more memory than the call has reserved."""
    size, allowed = PAIR_BYTES * pairs, BYTES_IN_HAND.get()
    if allowed is not None and size > max(allowed, LIGHT_BYTES):
        raise TooHeavyError(size)


Json = dict[str, Any]

# PostgreSQL's JSON keeps the text, and with it every bit of a float; JSONB would rewrite numbers.
RowId = Annotated[UUID, mapped_column(Uuid, primary_key=True, insert_default=new_id)]
Nanoseconds = Annotated[int, mapped_column(BigInteger)]
Bytes = Annotated[int, mapped_column(BigInteger)]
Name = Annotated[str, mapped_column(String(200))]
# A corner of the board. A row that names none means the tip.
Corner = Annotated[str, mapped_column(String(10), insert_default=TOP)]
Digest = Annotated[str, mapped_column(String(64))]
# The database's clock: rows that several hosts write are compared by it.
Created = Annotated[datetime, mapped_column(Instant, insert_default=now())]
Version = Annotated[int, mapped_column(Integer, insert_default=1)]


class Finite(TypeDecorator[float]):
    """A float that is a number, as in JSON columns: SQLite would make NULL of NaN, and backups carry numbers only."""

    impl = Double
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Raises ValueError for what is not finite."""
        if value is not None and not isfinite(value):
            raise ValueError(f"a number that is not finite would be stored: {value}")
        return value


_Row = TypeVar("_Row", bound="Base")


class Base(DeclarativeBase):
    """Declarative base; constraint names are fixed so that migrations can name them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {  # noqa: RUF012
        Json: JSON(none_as_null=True),
        list[Any]: JSON(none_as_null=True),
        datetime: Instant,
        float: Finite,
        UUID: Uuid,
    }

    @declared_attr.directive
    def __tablename__(cls) -> str:  # noqa: N805 - a class
        """The class's name in small letters: ``calibration_run``."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()


class Row(Base):
    """A row with an id of its own."""

    __abstract__ = True

    id: Mapped[RowId]


class Dated(Row):
    """A row that says when it was made."""

    __abstract__ = True

    created_at: Mapped[Created]


def partial_index(name: str, *columns: str, where: str, unique: bool = False) -> Index:
    """An index of the few rows that match ``where``, however many others there are.

    It serves statements that repeat the condition in the same words, with values by :func:`written`: no database
    finds a partial index by a parameter. A boolean column stands in it as ``IS_TRUE(column)``.
    """
    sqlite = re.sub(r"IS_TRUE\((\w+)\)", r"\1 = 1", where)
    postgresql = re.sub(r"IS_TRUE\((\w+)\)", r"\1", where)
    return Index(name, *columns, unique=unique, postgresql_where=text(postgresql), sqlite_where=text(sqlite))


def lasting_alias(table: type[_Row], name: str | None = None) -> type[_Row]:
    """Return an alias that a module keeps and all threads use. All its columns are looked up here.

    An alias of each statement's own would make every statement a new one, and compiling takes longer than running it.
    SQLAlchemy looks a column up at its first use. Of two threads that do so at once, one may get the table's own
    column and keep it (SQLAlchemy's issue 12302 is of this kind).
    """
    alias = aliased(table, name=name)
    for column in inspect(table).column_attrs:
        getattr(alias, column.key).__clause_element__()
    return alias


def state_literal(value: str) -> ColumnElement[str]:
    """A state, written out in the statement."""
    assert value.isidentifier(), value
    return literal_column(f"'{value}'", String())


def belongs_to(target: str, *, nullable: bool = False, index: bool = True, primary_key: bool = False) -> Any:
    """A foreign key whose rows go when the row that they belong to goes."""
    return mapped_column(
        ForeignKey(target, ondelete="CASCADE"), nullable=nullable, index=index, primary_key=primary_key
    )


def refers_to(target: str) -> Any:
    """A nullable foreign key that is emptied when its target goes."""
    return mapped_column(ForeignKey(target, ondelete="SET NULL"), nullable=True, index=True)


class Work(Dated):
    """A node of the tree of work; statements over sets of them stand in :mod:`service.platform.jobs.tree`.

    ``remaining`` counts its parts that have not ended: nodes whose ``PARENT`` it is, or else jobs.
    """

    __abstract__ = True
    PARENT: ClassVar[str | None] = None

    # First, for SQLite reads a row up to the column that it needs, and summaries are large.
    fleet_id: Mapped[UUID] = mapped_column(ForeignKey("fleet.id", ondelete="CASCADE"), index=True, sort_order=-1)
    state: Mapped[str] = mapped_column(String(20), default=WorkState.QUEUED, sort_order=-1)
    remaining: Mapped[int] = mapped_column(default=0, sort_order=-1)
    finished_at: Mapped[datetime | None] = mapped_column(sort_order=-1)
    problem: Mapped[Json | None]

    def reopen(self, state: WorkState, remaining: int = 0) -> None:
        """Take its end back, on a row that the caller has locked."""
        self.state, self.remaining, self.problem, self.finished_at = state, remaining, None, None
