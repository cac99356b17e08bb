"""One person holds a share of the threads at most, and nobody waits for threads and locks for ever."""

import threading
import time
from collections import Counter

import anyio
import psycopg.errors
import pytest
from sqlalchemy.exc import OperationalError

from service.platform.db.base import new_id, require_memory
from service.platform.http.limits import BusyProblem, ConcurrencyLimiter
from service.platform.http.threads import Lane

LOCKED = psycopg.errors.LockNotAvailable("canceling statement due to lock timeout")
FULL = psycopg.errors.DiskFull("could not extend file")


def failing(cause: Exception) -> None:
    raise OperationalError("UPDATE", {}, cause)


def test_who_waits_in_all_threads_of_their_share_leaves_one_to_others() -> None:
    gate, inside = threading.Event(), threading.Semaphore(0)

    def wait() -> None:
        inside.release()
        assert gate.wait(60)

    async def run() -> None:
        lane, busy, other = Lane(3, 2), new_id(), new_id()

        async def wait_as(caller: object) -> None:
            await lane.run(wait, caller=caller, wait_s=30)

        async with anyio.create_task_group() as group:
            for _ in range(10):
                group.start_soon(wait_as, busy)
            for _ in range(2):
                await anyio.to_thread.run_sync(inside.acquire)
            assert await lane.run(lambda: "served", caller=other, wait_s=30) == "served"
            assert not inside.acquire(blocking=False), "the busy one has more than their share"
            gate.set()

    anyio.run(run)


def test_who_gets_no_thread_is_told_so() -> None:
    gate, inside = threading.Event(), threading.Event()

    def wait() -> None:
        inside.set()
        assert gate.wait(60)

    async def run() -> None:
        lane = Lane(1)
        async with anyio.create_task_group() as group:
            group.start_soon(lane.run, wait)
            await anyio.to_thread.run_sync(inside.wait)
            with pytest.raises(BusyProblem) as caught:
                await lane.run(wait, wait_s=0.05)
            gate.set()
        assert (caught.value.status, caught.value.code) == (503, "busy")
        assert (caught.value.headers or {})["Retry-After"]
        assert await lane.run(lambda: 1) == 1, "the thread is not lost"

    anyio.run(run)


def test_who_finds_a_row_locked_tries_again_elsewhere_and_leaves_the_thread_to_others() -> None:
    tried, gate = Counter[str](), threading.Event()
    again = threading.Event()

    def change() -> str:
        tried["change"] += 1
        if tried["change"] == 1:
            failing(LOCKED)
        again.set()
        assert gate.wait(60)
        return "changed"

    async def run() -> None:
        lane = Lane(1, locked=Lane(1, 1))
        outcomes: list[str] = []

        async def change_it() -> None:
            outcomes.append(await lane.run(change, caller=new_id(), wait_s=30))

        async with anyio.create_task_group() as group:
            group.start_soon(change_it)
            await anyio.to_thread.run_sync(again.wait)
            assert await lane.run(lambda: "served", wait_s=30) == "served", "the only thread of the lane is free"
            gate.set()
        assert outcomes == ["changed"] and tried["change"] == 2

    anyio.run(run)


def test_who_never_gets_a_lock_hears_of_the_lock_and_in_time() -> None:
    async def run() -> None:
        lane = Lane(1, locked=Lane(1, 1))
        began = time.monotonic()
        with pytest.raises(OperationalError) as caught:
            await lane.run(failing, LOCKED, wait_s=0.3)
        assert time.monotonic() - began >= 0.3 and caught.value.orig is LOCKED
        # Where that lane is full, it is the lock all the same that is answered.
        with pytest.raises(OperationalError):
            await Lane(1, locked=Lane(0)).run(failing, LOCKED, wait_s=0.3)

    anyio.run(run)


def test_what_fails_otherwise_is_not_tried_again() -> None:
    async def run() -> None:
        tried: list[Exception] = []
        with pytest.raises(OperationalError):
            await Lane(1).run(lambda: (tried.append(FULL), failing(FULL)))
        assert tried == [FULL]

    anyio.run(run)


def test_what_needs_much_memory_is_called_again_where_it_has_it() -> None:
    tried: list[int] = []

    def read(pairs: int) -> str:
        tried.append(pairs)
        require_memory(pairs)
        return "read"

    async def run() -> None:
        lane = Lane(1)
        assert await lane.run(read, 100) == await lane.run(read, 100_000) == "read"
        assert tried == [100, 100_000, 100_000]
        lane._memory._heavy = ConcurrencyLimiter(0, wait_s=0.05)
        with pytest.raises(BusyProblem):
            await lane.run(read, 100_000)
        assert await lane.run(read, 100) == "read"

    anyio.run(run)
    require_memory(100_000)  # nobody counts elsewhere
