"""Reads states for many requests at once.

A request waits for a statement that begins after it came, so no answer is older than the request. While one runs,
further requests gather for the next. Nothing is kept between two statements, so the next one sees every change,
whoever made it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from psycopg import OperationalError

from apexcal.documents.publications import CURRENT
from service.calibrations.given_state import Look, Prepared, Seen, read_states
from service.db.loop_connection import LoopConnection
from service.db.session import Database

if TYPE_CHECKING:
    from psycopg.pq.abc import PGresult

# Their values, 6.5 kB, fit into a socket's buffer.
_MOST = 64

_Asked = tuple[Look, asyncio.Future[Seen]]

log = logging.getLogger(__name__)


class StateReader:
    """Gathers requests and reads for them. It belongs to one event loop.

    The loop itself reads PostgreSQL, over a connection that stays open. A thread reads SQLite, and PostgreSQL while
    there is no such connection.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._pool = ThreadPoolExecutor(1, "given-state")
        self._waiting: dict[str, list[_Asked]] = {}
        self._is_reading = False
        self._is_closed = False
        self._connection: LoopConnection | None = None
        self._statements: dict[bool, Prepared] = {}

    async def read(self, look: Look) -> Seen:
        """What is there now. Raises what the database raises."""
        found: asyncio.Future[Seen] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(look.alias, []).append((look, found))
        self._go_on()
        return await found

    def close(self) -> None:
        """End the thread and the connection. Who still waits is cancelled."""
        self._is_closed = True
        for asked in self._waiting.values():
            for _, future in asked:
                future.cancel()
        self._waiting.clear()
        self._pool.shutdown(cancel_futures=True)
        if self._connection is not None:
            self._connection.close()

    def _go_on(self) -> None:
        """Read for those of one alias who wait, if nothing is being read."""
        if self._is_reading or not self._waiting:
            return
        self._is_reading = True
        alias = next(iter(self._waiting))
        asked = self._waiting.pop(alias)
        batch, rest = asked[:_MOST], asked[_MOST:]
        if rest:  # after the other aliases
            self._waiting[alias] = rest
        if self._connection is None or not self._connection.is_open:
            self._read_in_thread(batch)
            return
        statement = self._statements[alias == CURRENT]
        values = statement.values(alias, [look for look, _ in batch])
        self._connection.execute(statement.text, values, lambda found: self._came(batch, found))

    def _came(self, batch: Sequence[_Asked], found: PGresult | OperationalError) -> None:
        if self._is_closed:
            self._answer(batch, asyncio.CancelledError())
            return
        if isinstance(found, OperationalError):
            # The connection may have ended. Another one shows what is wrong, in SQLAlchemy's errors.
            self._read_in_thread(batch)
            return
        try:
            seen = Prepared.seen(len(batch), found)
        except Exception as error:  # a fault of ours: who waits is told, and the next are read for
            self._answer(batch, error)
        else:
            self._answer(batch, seen)

    def _read_in_thread(self, batch: Sequence[_Asked]) -> None:
        looks = [look for look, _ in batch]
        reading = asyncio.get_running_loop().run_in_executor(self._pool, self._read_once, looks)

        def done(_: object) -> None:
            found = asyncio.CancelledError() if reading.cancelled() else reading.exception() or reading.result()
            self._answer(batch, found)

        reading.add_done_callback(done)

    def _read_once(self, looks: Sequence[Look]) -> list[Seen]:
        """Read over a connection of the pool, and connect for those who ask later."""
        with self._database.alone() as connection:
            found = read_states(connection, looks[0].alias, looks)
            dialect = connection.dialect
        if dialect.name == "postgresql":
            self._statements = {is_current: Prepared.of(dialect, is_current) for is_current in (True, False)}
            try:
                self._connection = LoopConnection(self._database, [one.text for one in self._statements.values()])
            except OperationalError:
                log.warning("no connection for reading states; it is tried again", exc_info=True)
        return found

    def _answer(self, batch: Sequence[_Asked], found: Sequence[Seen] | BaseException) -> None:
        self._is_reading = False
        self._go_on()
        for place, (_, future) in enumerate(batch):
            if future.done():  # its client has left
                continue
            if isinstance(found, asyncio.CancelledError):
                future.cancel()
            elif isinstance(found, BaseException):
                future.set_exception(found)
            else:
                future.set_result(found[place])
