"""One caller holds a share of the threads at most, and nobody waits for a thread for ever."""

import threading

import anyio
import pytest

from service.db.ids import new_id
from service.http import threads
from service.http.problems import Problem
from service.http.threads import Lane


def test_who_waits_in_all_threads_of_their_share_leaves_one_to_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "LOCK_S", 30)
    gate, inside = threading.Event(), threading.Semaphore(0)

    def wait() -> None:
        inside.release()
        assert gate.wait(60)

    async def run() -> None:
        lane, busy, other = Lane(3, 2), new_id(), new_id()

        async def wait_as(caller: object) -> None:
            await lane.run(wait, caller=caller)

        async with anyio.create_task_group() as group:
            for _ in range(10):
                group.start_soon(wait_as, busy)
            for _ in range(2):
                await anyio.to_thread.run_sync(inside.acquire)
            assert await lane.run(lambda: "served", caller=other) == "served"
            assert not inside.acquire(blocking=False), "the busy one has more than their share"
            gate.set()

    anyio.run(run)


def test_who_gets_no_thread_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "LOCK_S", 0.05)
    gate, inside = threading.Event(), threading.Event()

    def wait() -> None:
        inside.set()
        assert gate.wait(60)

    async def run() -> None:
        lane = Lane(1)
        async with anyio.create_task_group() as group:
            group.start_soon(lane.run, wait)
            await anyio.to_thread.run_sync(inside.wait)
            with pytest.raises(Problem) as caught:
                await lane.run(wait)
            gate.set()
        assert (caught.value.status, caught.value.code) == (503, "busy")
        assert (caught.value.headers or {})["Retry-After"]
        assert await lane.run(lambda: 1) == 1, "the thread is not lost"

    anyio.run(run)
