"""The one way to the database: a writing session and a reading one, on SQLite and PostgreSQL alike.

A transaction whose content took minutes to compute is repeated after a deadlock. :func:`put` writes a row that
several processes may be the first to write.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

from pydantic_core import from_json
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import ExceptionContext, make_url
from sqlalchemy.exc import DisconnectionError, OperationalError
from sqlalchemy.orm import Session, sessionmaker

import service.platform.db.models  # noqa: F401  # a flush sorts tables by their foreign keys, so all of them must be known
from apexcal.documents.base import not_finite
from apexcal.documents.errors import DocumentError
from service.platform.db.base import Base, Json
from service.platform.db.connection import LOCK_S, connect_args
from service.platform.db.effects import watch

_WRITES = "apexcal_writes"
_ALONE = "apexcal_alone"
# Seconds since its last use within which a pooled connection is taken to work still.
_FRESH_S = 1.0
_LEFT = "apexcal_left"
_OUTBOX = "apexcal_outbox"

log = logging.getLogger(__name__)


def post(session: Session, courier: str, item: Any) -> None:
    """Hand ``item`` to a courier of the database after this session's commit; a rollback forgets it."""
    session.info.setdefault(_OUTBOX, {}).setdefault(courier, []).append(item)


def upserting(dialect: str, model: Any) -> Any:
    """An insert of this kind of database into a model's table or a table, for ``on_conflict_do_...``."""
    return (sqlite if dialect == "sqlite" else postgresql).insert(model)


class Encoded(Json):
    """A JSON object, its members in the order of their names, with its text, made before a lock is held.

    Raises :class:`DocumentError` ``non_finite``.
    """

    def __init__(self, members: Json) -> None:
        super().__init__(sorted(members.items()))
        # Column by column: others have the interpreter in between.
        self.text = "{" + ", ".join(f"{json.dumps(name)}: {_to_json(value)}" for name, value in self.items()) + "}"


def _to_json(value: Any) -> str:
    """Text of a JSON column. PostgreSQL refuses NaN and Infinity, and SQLite could not read them again.

    Raises:
        DocumentError: ``non_finite``, which names the member.
    """
    if isinstance(value, Encoded):
        return value.text
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        raise DocumentError(
            "non_finite",
            f"{not_finite(value) or 'A number'} of the result is not finite: the data do not determine it.",
            "Give more data, or lock what is known. Nothing was stored.",
        ) from None


def _from_json(text: str | bytes) -> Any:
    """Value of a JSON column. Of 100,000 pairs the standard library would hold the interpreter five times as long."""
    try:
        return from_json(text)
    except ValueError:  # half of a surrogate pair
        return json.loads(text)


def open_engine(url: str, *, patient: bool = False, lock_s: float = LOCK_S, connections: int | None = None) -> Engine:
    """An engine for ``url``. Open it after a fork, never before.

    ``patient``: see :mod:`service.platform.db.connection`.

    ``lock_s``: how long a lock is waited for. ``connections``: as many are kept, and no more are opened.

    SQLite: write-ahead log, full synchronisation of transactions, and `BEGIN IMMEDIATE` for sessions that write, so
    that two writers queue up instead of failing on an upgrade of their locks.
    """
    parsed = make_url(url)
    texts: Any = {"json_serializer": _to_json, "json_deserializer": _from_json}
    pool: Any = {"pool_size": connections or 5, "max_overflow": 0 if connections else 20, "pool_use_lifo": True}
    if parsed.get_backend_name() != "sqlite":
        waits = connect_args(parsed, patient=patient, lock_s=lock_s)
        engine = create_engine(parsed, **texts, connect_args=waits, **pool)
        _ping_before_use(engine)
        _leave_who_takes_no_writes(engine)
        return engine
    engine = create_engine(url, **texts, connect_args={"timeout": lock_s, "check_same_thread": False}, **pool)

    @event.listens_for(engine, "connect")
    def configure(connection: Any, record: object) -> None:
        connection.isolation_level = None
        for pragma in ("journal_mode=WAL", "foreign_keys=ON", f"busy_timeout={round(lock_s * 1000)}"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        options = connection.get_execution_options()
        driver: Any = connection.connection.driver_connection
        driver.execute(f"PRAGMA synchronous={'NORMAL' if options.get(_ALONE) else 'FULL'}")
        if not options.get(_ALONE):
            connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get(_WRITES) else "BEGIN DEFERRED")

    return engine


def _ping_before_use(engine: Engine) -> None:
    """Replace pooled connections that the server has closed meanwhile.

    As SQLAlchemy's ``pool_pre_ping``, which would ask the server before each of a job's three transactions.
    """

    @event.listens_for(engine, "checkin")
    def left(connection: Any, record: Any) -> None:
        record.info[_LEFT] = time.monotonic()

    @event.listens_for(engine, "checkout")
    def ping(connection: Any, record: Any, proxy: object) -> None:
        last = record.info.get(_LEFT)
        if last is None or time.monotonic() - last < _FRESH_S:
            return
        try:
            engine.dialect.do_ping(connection)
        except engine.dialect.loaded_dbapi.Error as error:
            raise DisconnectionError from error


def _leave_who_takes_no_writes(engine: Engine) -> None:
    """Take a server's refusal of all writes as if it did not answer, and connect anew.

    During a failover the server may be the standby, or the former primary: who waits reaches the new one.
    """

    @event.listens_for(engine, "handle_error")
    def refused(context: ExceptionContext) -> OperationalError | None:
        error = context.original_exception
        # Class 25, invalid transaction state: read_only_sql_transaction among them.
        if not (getattr(error, "sqlstate", None) or "").startswith("25"):
            return None
        context.is_disconnect, context.invalidate_pool_on_disconnect = True, False
        return OperationalError(context.statement, None, error, connection_invalidated=True)


def _autocommit(engine: Engine) -> dict[str, Any]:
    # SQLite's connections are in this mode anyway: their transactions begin with a statement of ours.
    return {} if engine.dialect.name == "sqlite" else {"isolation_level": "AUTOCOMMIT"}


def _repeatable(engine: Engine) -> dict[str, Any]:
    # SQLite's transactions see one moment anyway.
    return {} if engine.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}


class Database:
    """Sessions of one engine.

    ``couriers`` take what sessions posted, by name, once it is committed. They carry hints, so what a courier
    fails to deliver is logged and nothing else: the tables say what is true. ``patient``: for commands of operators.
    """

    def __init__(
        self, url: str, *, patient: bool = False, lock_s: float = LOCK_S, connections: int | None = None
    ) -> None:
        self.engine = open_engine(url, patient=patient, lock_s=lock_s, connections=connections)
        self._is_closed = False
        event.listen(self.engine, "checkin", self._close_late)
        self.couriers: dict[str, Callable[[list[Any]], None]] = {}
        self._snapshot = sessionmaker(
            self.engine.execution_options(**_repeatable(self.engine)), expire_on_commit=False
        )
        # No statement changes objects that the session holds.
        self._writing = sessionmaker(
            self.engine.execution_options(**{_WRITES: True}),
            expire_on_commit=False,
            execution_options={"synchronize_session": False},
        )
        watch(self._writing)
        self._alone = self.engine.execution_options(**{_ALONE: True}, **_autocommit(self.engine))
        self._reading = sessionmaker(self._alone, autoflush=False, expire_on_commit=False)

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """A session that only reads, on a connection as :meth:`alone` has it: each statement sees its own moment.

        None of them ends with a rollback: psycopg forgets the prepared statements of a connection with each.
        """
        with self._reading() as session:
            yield session

    @contextmanager
    def snapshot(self) -> Iterator[Session]:
        """A session that only reads, all of it as it was at the session's first statement."""
        with self._snapshot() as session:
            yield session
            session.commit()  # nothing: see `reading`

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """A session that commits when the block ends, and rolls back when it raises."""
        with self._writing() as session:
            with session.begin():
                yield session
            self._deliver(session.info.pop(_OUTBOX, {}))

    @contextmanager
    def alone(self) -> Iterator[Connection]:
        """A connection on which each statement is a transaction of its own: one trip to the server, not three.

        For claims, renewals and reads. SQLite does not sync it: what a machine loses with its power is what its own
        processes held, and they are gone too. PostgreSQL's workers on other machines would go on, so it syncs.
        """
        with self._alone.connect() as connection:
            yield connection

    def _deliver(self, outbox: dict[str, list[Any]]) -> None:
        for name, items in outbox.items():
            courier = self.couriers.get(name)
            try:
                if courier:
                    courier(items)
            except Exception:
                log.exception("courier %s did not deliver %d items", name, len(items))

    def close(self) -> None:
        """Close every connection: pooled ones now, those in use when they come back."""
        self._is_closed = True
        self.engine.dispose()

    def _close_late(self, connection: Any, record: Any) -> None:
        if self._is_closed:  # its pool is gone, and nobody else would
            record.close()


def put(
    session: Session | Connection,
    model: type[Base],
    key: Mapping[str, Any],
    values: Mapping[str, Any] | None = None,
    *,
    first: Mapping[str, Any] | None = None,
) -> None:
    """Write ``values`` to the row with this key, and make it with ``first`` besides if nobody has.

    Neither of two that do so at once fails. ``key`` names a primary or unique key's columns.
    """
    engine = session.get_bind() if isinstance(session, Session) else session
    statement = upserting(engine.dialect.name, model).values(**(first or {}), **key, **(values or {}))
    if values:
        statement = statement.on_conflict_do_update(index_elements=list(key), set_=dict(values))
    else:
        statement = statement.on_conflict_do_nothing(index_elements=list(key))
    session.execute(statement)


# Seconds between the tries. Together less than half a lease; a database that is away for longer is no deadlock.
_PAUSES_S = (0.05, 0.2, 0.5, 1.0, 2.0)

T = TypeVar("T")


def repeated(transaction: Callable[[], T]) -> T:
    """Return what ``transaction`` returns; repeat it if the database ended it in favour of another one.

    PostgreSQL does so in a deadlock, SQLite where it gets no lock. A connection that broke may have committed: so
    ``transaction`` must refuse to be done twice, as the gate of a job's finish does.
    """
    for pause in _PAUSES_S:
        try:
            return transaction()
        except OperationalError as error:
            log.warning("a transaction is done again: %s", str(error.orig).partition("\n")[0])
            time.sleep(pause)
    return transaction()
