"""The one way to the database: a writing session and a reading one, on SQLite and PostgreSQL alike."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session, sessionmaker

import service.db.models  # noqa: F401  # a flush sorts tables by their foreign keys, so all of them must be known

_WRITES = "apexcal_writes"
_OUTBOX = "apexcal_outbox"

log = logging.getLogger(__name__)


def post(session: Session, courier: str, item: Any) -> None:
    """Hand ``item`` to a courier of the database after this session's commit; a rollback forgets it."""
    session.info.setdefault(_OUTBOX, {}).setdefault(courier, []).append(item)


def _to_json(value: Any) -> str:
    """Text of a JSON column. PostgreSQL refuses NaN and Infinity, and SQLite could not read them again."""
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError as error:
        raise ValueError(f"a number that is not finite would be stored: {error}") from None


def open_engine(url: str) -> Engine:
    """An engine for ``url``. Open it after a fork, never before.

    SQLite: write-ahead log, full synchronisation, and `BEGIN IMMEDIATE` for sessions that write, so that two
    writers queue up instead of failing on an upgrade of their locks.
    """
    if make_url(url).get_backend_name() != "sqlite":
        # A host that does not even refuse would be waited for as long as TCP likes.
        patience = {"connect_timeout": 5}
        pooled = {"pool_pre_ping": True, "pool_size": 5, "max_overflow": 20}
        return create_engine(url, json_serializer=_to_json, connect_args=patience, **pooled)
    engine = create_engine(url, json_serializer=_to_json, connect_args={"timeout": 30, "check_same_thread": False})

    @event.listens_for(engine, "connect")
    def configure(connection: Any, record: object) -> None:
        connection.isolation_level = None
        for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "busy_timeout=30000"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get(_WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN DEFERRED")

    return engine


class Database:
    """Sessions of one engine.

    ``couriers`` take what sessions posted, by name, once it is committed. They carry hints, so what a courier
    fails to deliver is logged and nothing else: the tables say what is true.
    """

    def __init__(self, url: str) -> None:
        self.engine = open_engine(url)
        self.couriers: dict[str, Callable[[list[Any]], None]] = {}
        self._reading = sessionmaker(self.engine, expire_on_commit=False)
        self._writing = sessionmaker(self.engine.execution_options(**{_WRITES: True}), expire_on_commit=False)

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session that only reads; whatever it changed is rolled back."""
        with self._reading() as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """A session that commits when the block ends, and rolls back when it raises."""
        with self._writing() as session:
            with session.begin():
                yield session
            self._deliver(session.info.pop(_OUTBOX, {}))

    def _deliver(self, outbox: dict[str, list[Any]]) -> None:
        for name, items in outbox.items():
            courier = self.couriers.get(name)
            try:
                if courier:
                    courier(items)
            except Exception:
                log.exception("courier %s did not deliver %d items", name, len(items))

    def close(self) -> None:
        """Close every pooled connection."""
        self.engine.dispose()
