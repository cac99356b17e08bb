"""Small statements at the beginning of most requests, such as who calls; on PostgreSQL the event loop waits for them.

A thread that waits has to be woken twice, and shares the interpreter with the event loop. For a statement of a
millisecond that costs more than the statement. SQLite has no server to wait for, so its statements run in a thread.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any
from uuid import UUID

from sqlalchemy import Select

from service.platform.db.session import Database
from service.platform.http.threads import WAIT_S, Threads

if TYPE_CHECKING:
    from service.platform.db.loop_connections import LoopConnections

# Two statements run at once on a second core; the others wait in the loop.
_CONNECTIONS = 4

log = logging.getLogger(__name__)


class Lookups:
    """Statements that are compiled once and then run for many requests."""

    def __init__(self, database: Database, threads: Threads) -> None:
        self._database, self._threads = database, threads
        self._dialect = database.engine.dialect
        self._loop: LoopConnections | None = None
        if self._dialect.name == "postgresql":
            from service.platform.db.loop_connections import LoopConnections  # loads the driver

            self._loop = LoopConnections(database, _CONNECTIONS, WAIT_S)
        self._compiled: dict[Select[Any], tuple[bytes, Mapping[str, Any]]] = {}

    async def close(self) -> None:
        """Close the connections."""
        if self._loop is not None:
            await self._loop.close()

    async def rows(
        self, statement: Select[Any], values: Mapping[str, Any], secret_hash: str
    ) -> Sequence[Sequence[Any]]:
        """Return the rows of a statement in a transaction of its own. Columns: text, numbers, truth values and ids.

        Args:
            secret_hash: of the caller's credential. One credential may hold all threads of the lane but one.
        """
        if self._loop is not None:
            if statement not in self._compiled:
                compiled = statement.compile(dialect=self._dialect)
                self._compiled[statement] = str(compiled).encode(), compiled.params
            text, defaults = self._compiled[statement]
            try:
                return await self._loop.rows(text, {**defaults, **values})
            except self._loop.errors:
                # The connection may have ended. The thread opens a new one, or reports what is wrong.
                log.info("a look-up is repeated in a thread", exc_info=True)
        return await self._threads.identity.run(self._rows, statement, values, caller=UUID(hex=secret_hash[:32]))

    def _rows(self, statement: Select[Any], values: Mapping[str, Any]) -> Sequence[Sequence[Any]]:
        with self._database.alone() as connection:
            return connection.execute(statement, values).all()
