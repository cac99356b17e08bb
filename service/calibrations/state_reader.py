"""Reads states for many requests at once, over connections that stay open.

A request waits for a statement that begins after it came, so no answer is older than the request. While one runs,
further requests gather for the next. Nothing is kept between two statements, so the next one sees every change,
whoever made it.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError

from service.calibrations.given_state import Look, Seen, read_states
from service.db.session import Database

# Statements under way at once: one is read while the next is sent.
_AT_ONCE = 2
_MOST = 64


class StateReader:
    """Gathers requests and reads for them. It belongs to one event loop."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._pool = ThreadPoolExecutor(_AT_ONCE, "given-state")
        self._kept: list[_Kept] = []
        self._waiting: list[tuple[Look, asyncio.Future[Seen]]] = []
        self._under_way = 0

    async def read(self, look: Look) -> Seen:
        """What is there now. Raises what the database raises."""
        found: asyncio.Future[Seen] = asyncio.get_running_loop().create_future()
        self._waiting.append((look, found))
        self._go_on()
        return await found

    def close(self) -> None:
        """End the threads and give their connections back."""
        self._pool.shutdown(cancel_futures=True)
        self._give_back()

    def _give_back(self) -> None:
        while True:
            try:
                kept = self._kept.pop()
            except IndexError:  # the other thread may have taken the last one
                return
            kept.stack.close()

    def _go_on(self) -> None:
        if not self._waiting or self._under_way == _AT_ONCE:
            return
        batch, self._waiting = self._waiting[:_MOST], self._waiting[_MOST:]
        self._under_way += 1
        reading = asyncio.get_running_loop().run_in_executor(self._pool, self._read, [look for look, _ in batch])
        reading.add_done_callback(lambda done: self._answer([future for _, future in batch], done))

    def _answer(self, waiting: Sequence[asyncio.Future[Seen]], done: asyncio.Future[list[Seen]]) -> None:
        self._under_way -= 1
        self._go_on()
        error = None if done.cancelled() else done.exception()
        for place, future in enumerate(waiting):
            if future.done():  # its client has left
                continue
            if done.cancelled():
                future.cancel()
            elif error:
                future.set_exception(error)
            else:
                future.set_result(done.result()[place])

    def _read(self, looks: Sequence[Look]) -> list[Seen]:
        try:
            return self._read_once(looks)
        except (DBAPIError, self._database.engine.dialect.loaded_dbapi.Error):
            # The kept connections may have ended. A fresh one shows what is wrong, in SQLAlchemy's errors.
            self._give_back()
            with self._database.alone() as connection:
                return _read_all(connection, None, looks)

    def _read_once(self, looks: Sequence[Look]) -> list[Seen]:
        with self._connection() as kept:
            return _read_all(kept.connection, kept.cursor, looks)

    @contextmanager
    def _connection(self) -> Iterator[_Kept]:
        """A connection that stays open: taking one from the pool costs as much as the statement. Errors close it."""
        try:
            kept = self._kept.pop()
        except IndexError:
            kept = _Kept.open(self._database)
        try:
            yield kept
        except BaseException:
            kept.stack.close()
            raise
        self._kept.append(kept)


class _Kept(NamedTuple):
    connection: Connection
    stack: ExitStack
    cursor: Any

    @staticmethod
    def open(database: Database) -> _Kept:
        stack = ExitStack()
        connection = stack.enter_context(database.alone())
        cursor = None
        if connection.dialect.name == "postgresql":
            # Otherwise PostgreSQL plans at each execution, which takes ten times as long as the execution. It expects
            # ten rows of an array of unknown length, so a general plan seems to cost more than one for the usual row.
            connection.exec_driver_sql("SET plan_cache_mode = force_generic_plan")
            # The setting must not reach other statements: the connection is closed, and does not return to the pool.
            connection.detach()
            # One cursor for all statements: each new one works out again how its values are sent.
            cursor = connection.connection.cursor()
        return _Kept(connection, stack, cursor)


def _read_all(connection: Connection, cursor: Any, looks: Sequence[Look]) -> list[Seen]:
    """One statement for each alias."""
    by_alias: dict[str, list[int]] = defaultdict(list)
    for place, look in enumerate(looks):
        by_alias[look.alias].append(place)
    found: dict[int, Seen] = {}
    for alias, places in by_alias.items():
        states = read_states(connection, alias, [looks[place] for place in places], cursor)
        found.update(zip(places, states, strict=True))
    return [found[place] for place in range(len(looks))]
