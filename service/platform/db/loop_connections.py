"""Connections to PostgreSQL that the event loop itself waits for, used by `http.lookups` alone."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from psycopg import AsyncConnection, Error

from service.platform.db.connection import connect_args
from service.platform.db.session import Database

# Planning a statement of ten joins takes ten times as long as a few look-ups by index.
_GENERIC_PLANS = "-c plan_cache_mode=force_generic_plan"


class LoopConnections:
    """At most ``count`` connections of one event loop, opened when they are needed.

    Each statement is prepared, and runs in a transaction of its own.
    """

    errors = (Error, TimeoutError)
    """Errors of :meth:`rows`."""

    def __init__(self, database: Database, count: int, lock_s: float) -> None:
        """``lock_s``: how long a statement waits for a lock, and a request for a connection."""
        url = database.engine.url
        self._arguments, named = database.engine.dialect.create_connect_args(url)
        waits = connect_args(url, patient=False, lock_s=lock_s)
        waits["options"] += f" {_GENERIC_PLANS}"
        self._named: dict[str, Any] = {**named, **waits, "autocommit": True, "prepare_threshold": 0}
        self._lock_s = lock_s
        self._free = asyncio.Semaphore(count)
        self._idle: list[AsyncConnection[tuple[Any, ...]]] = []

    async def rows(self, statement: bytes, values: Mapping[str, Any]) -> list[tuple[Any, ...]]:
        """Return the rows of a statement. Raises the driver's errors; TimeoutError if none is free in time."""
        async with asyncio.timeout(self._lock_s):
            await self._free.acquire()
        try:
            connection = self._idle.pop() if self._idle else await self._connect()
            try:
                cursor = await connection.execute(statement, values)
                rows = await cursor.fetchall()
            except BaseException:
                await connection.close()
                raise
            self._idle.append(connection)
            return rows
        finally:
            self._free.release()

    async def close(self) -> None:
        """Close the idle connections."""
        while self._idle:
            await self._idle.pop().close()

    async def _connect(self) -> AsyncConnection[tuple[Any, ...]]:
        return await AsyncConnection.connect(*self._arguments, **self._named)
