"""Statements that an event loop waits for: on few connections, and over new ones where the server ended them."""

from __future__ import annotations

import asyncio

import psycopg
import pytest
import uvloop

from service.platform.db.loop_connections import LoopConnections

pytestmark = pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)

_PID = b"SELECT pg_backend_pid(), %(value)s::int"


@pytest.mark.parametrize("make_loop", [asyncio.new_event_loop, uvloop.new_event_loop])
def test_many_at_once_share_a_few_connections(database, make_loop):
    async def ask():
        loop = LoopConnections(database, 2, 5)
        rows = await asyncio.gather(*(loop.rows(_PID, {"value": value}) for value in range(20)))
        await loop.close()
        return [row for (row,) in rows]

    with asyncio.Runner(loop_factory=make_loop) as runner:
        rows = runner.run(ask())
    assert [value for _, value in rows] == list(range(20)) and len({pid for pid, _ in rows}) == 2


def test_a_connection_that_failed_is_replaced(database):
    async def ask():
        loop = LoopConnections(database, 1, 5)
        first = await loop.rows(_PID, {"value": 1})
        with pytest.raises(psycopg.Error):
            await loop.rows(b"SELECT pg_terminate_backend(pg_backend_pid())", {})
        second = await loop.rows(_PID, {"value": 1})
        with pytest.raises(psycopg.errors.UndefinedTable):
            await loop.rows(b"SELECT * FROM nothing", {})
        third = await loop.rows(_PID, {"value": 1})
        await loop.close()
        return first, second, third

    assert len({pid for ((pid, _),) in asyncio.run(ask())}) == 3


def test_who_finds_no_connection_free_is_told(database):
    async def ask():
        loop = LoopConnections(database, 1, 1)
        busy = asyncio.ensure_future(loop.rows(b"SELECT pg_sleep(60)", {}))
        while not loop._free.locked():
            await asyncio.sleep(0)
        with pytest.raises(TimeoutError):
            await loop.rows(_PID, {"value": 1})
        busy.cancel()
        with pytest.raises((asyncio.CancelledError, psycopg.Error)):
            await busy
        assert await loop.rows(_PID, {"value": 1})
        await loop.close()

    asyncio.run(ask())
