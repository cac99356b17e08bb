"""A connection to PostgreSQL that the event loop itself waits for.

A thread that waits for an answer has to be woken twice, and shares the interpreter with the loop that it answers to:
under load that takes longer than the statement.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from psycopg import OperationalError
from psycopg.pq import ExecStatus

from service.db.session import Database

if TYPE_CHECKING:
    from psycopg.pq.abc import PGresult

Then = Callable[["PGresult | OperationalError"], None]


class LoopConnection:
    """Executes prepared statements, one at a time. It belongs to the event loop that first executes one."""

    def __init__(self, database: Database, statements: Iterable[str]) -> None:
        """Connect and prepare, and wait for that. Raises psycopg's OperationalError."""
        self._driver = database.driver_connection()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._then: Then | None = None
        self._result: PGresult | None = None
        self._names: dict[str, bytes] = {}
        try:
            self._prepare(statements)
        except OperationalError:
            self._driver.close()
            raise
        self._socket = self._driver.pgconn.socket

    @property
    def is_open(self) -> bool:
        """Whether it may be used. The server may have ended it."""
        return not self._driver.closed

    def execute(self, text: str, values: Sequence[bytes], then: Then) -> None:
        """Send values to a prepared statement. ``then`` gets the rows, with values as text, or an error."""
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
            self._loop.add_reader(self._socket, self._read)
        self._then = then
        try:
            # It does not wait while the values fit into the socket's buffer, which is empty.
            self._driver.pgconn.send_query_prepared(self._names[text], values)
        except OperationalError as error:
            self._end(error)

    def close(self) -> None:
        """End the connection; who waits for rows gets an error."""
        self._end(OperationalError("the connection was closed"))

    def _prepare(self, statements: Iterable[str]) -> None:
        pgconn = self._driver.pgconn
        # Otherwise PostgreSQL plans at each execution, which takes ten times as long as the execution. It expects
        # ten rows of an array of unknown length, so a general plan seems to cost more than one for the usual row.
        _checked(pgconn.exec_(b"SET plan_cache_mode = force_generic_plan"))
        for text in statements:
            name = self._names[text] = b"s%d" % len(self._names)
            _checked(pgconn.prepare(name, text.encode()))

    def _read(self) -> None:
        pgconn = self._driver.pgconn
        try:
            pgconn.consume_input()
            while not pgconn.is_busy():
                result = pgconn.get_result()
                if result is None:
                    break
                self._result = result
            else:
                return
            found = _checked(self._result)
        except OperationalError as error:
            self._end(error)
            return
        self._tell(found)

    def _tell(self, found: PGresult | OperationalError) -> None:
        then, self._then, self._result = self._then, None, None
        if then is not None:
            then(found)

    def _end(self, error: OperationalError) -> None:
        if self._loop is not None:
            self._loop.remove_reader(self._socket)
        self._driver.close()
        self._tell(error)


def _checked(result: Any) -> Any:
    """The result. Raises psycopg's OperationalError where it is none of rows or of a command."""
    if result is None or result.status not in (ExecStatus.TUPLES_OK, ExecStatus.COMMAND_OK):
        message = b"" if result is None else result.error_message
        raise OperationalError(message.decode(errors="replace"))
    return result
