"""The lanes of threads in which an API process calls the database, one lane for each kind of work.

A thread waits while its statement runs or its row is locked. If all work shared one pool, requests that wait for one
locked row would hold every thread, and nobody else would be answered. So readers, writers, markers and sign-ins have
lanes of their own. A call that meets a lock leaves its lane and is tried again in a small lane for such calls; one
that needs much memory waits until it has that.
"""

from __future__ import annotations

import math
from asyncio import sleep
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from functools import partial
from time import monotonic
from typing import Any, TypeVar
from uuid import UUID

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from sqlalchemy.exc import OperationalError

from service.platform.db.base import BYTES_IN_HAND, LIGHT_BYTES, TooHeavyError
from service.platform.http.limits import BusyProblem, ConcurrencyLimiter
from service.platform.http.problems import is_locked
from service.platform.settings import MIB

# Reads wait for no lock, so a locked row never occupies these.
_READERS = 8
_WRITERS = 6
# Marking tasks are bound by the processor. With 44 people, three threads answered as fast as forty, and everybody
# else's requests ten times sooner (p95 27 ms instead of 217).
_MARKING = 3
# Identifying a caller is one statement; it waits for no body and no lock.
_IDENTITY = 3
# Requests that timed out on a lock: at most two threads retry them.
_LOCKED = 2
# Readers that parse a request's body at once, such as a file of 60 kB, for up to 0.4 s each.
_PARSERS = 2
# Calls with more than 8 MiB in hand: at most four, or three people's sets of 100,000 pairs.
_HEAVY = 4
_HEAVY_MIB = 216
# Calls with less: most wait for a client that sends or takes bytes, such as 4 MiB of a frame.
_LIGHT = 64
# All other work, such as upkeep. This sets anyio's own limit, 40 by default.
OTHERS = 6
# One connection for each thread, so that no thread waits for a connection.
CONNECTIONS = _READERS + _WRITERS + _MARKING + _IDENTITY + _LOCKED + _HEAVY + OTHERS
# Longest wait for threads and locks together. Rows are locked for milliseconds. Of sixty requests for one row within
# a second, each hears within half a second, so that the last one has its answer well before 6 s.
WAIT_S = 4.0
# Longest wait for memory and for parsers. Clients and proxies wait longer than that for an answer.
MEMORY_WAIT_S = 30.0
# Longest wait of one try for one lock. PostgreSQL may let a statement wait twice for a row: behind other waiters,
# then for the holder.
LOCK_S = 0.1
# Longest turn of a computing thread with the interpreter. A request takes some 25 turns: with Python's own 5 ms it
# took 0.13 s beside a thread that parses.
SWITCH_S = 0.0005
# Pause between two tries, in case the database refuses a lock at once.
_PAUSE_S = 0.02

ValueT = TypeVar("ValueT")

# The lane has counted the thread already.
_UNLIMITED = CapacityLimiter(math.inf)


class Memory:
    """The bytes that all requests of a process may have in hand, beyond what every request takes."""

    def __init__(self) -> None:
        self._light = ConcurrencyLimiter(_LIGHT, _LIGHT // 4, MEMORY_WAIT_S)
        self._heavy = ConcurrencyLimiter(_HEAVY_MIB, _HEAVY_MIB // 3, MEMORY_WAIT_S)

    def take(self, person_id: UUID | None, size: int) -> AbstractAsyncContextManager[None]:
        """Reserve ``size`` bytes for a block. Raises :class:`BusyProblem` after :data:`MEMORY_WAIT_S`."""
        if size <= LIGHT_BYTES:
            return self._light.take(person_id)
        return self._heavy.take(person_id, count=max(size // MIB + 1, _HEAVY_MIB // _HEAVY))


class Lane:
    """Threads for one kind of work.

    Args:
        threads: how many there are.
        each: how many of them one person may hold.
        locked: the lane in which calls that met a locked row are tried again.
        memory: that calls with much data wait for; while they have it, they count in no lane.
    """

    def __init__(
        self, threads: int, each: int | None = None, locked: Lane | None = None, memory: Memory | None = None
    ) -> None:
        self._limiter = ConcurrencyLimiter(threads, each)
        self._locked = locked or self
        self._memory = memory or Memory()

    async def run(
        self,
        call: Callable[..., ValueT],
        *args: Any,
        caller: UUID | None = None,
        wait_s: float = WAIT_S,
        **named: Any,
    ) -> ValueT:
        """Return the result of ``call``, called in a thread. The call commits at most once, as its last step.

        If it meets a lock or needs much memory, it is rolled back and its thread is free. Then it is called again: in
        the lane for locked rows, or with the memory reserved.

        Raises:
            BusyProblem: no thread was free for ``wait_s`` seconds.
            OperationalError: a lock was held for ``wait_s`` seconds, waits for threads included.
        """
        ends_at, lane, locked, size = monotonic() + wait_s, self, None, 0
        while True:
            share = self._memory.take(caller, size) if size else lane._limiter.take(caller, ends_at - monotonic())
            token = BYTES_IN_HAND.set(size)
            try:
                async with share:
                    return await run_sync(partial(call, *args, **named), limiter=_UNLIMITED)
            except BusyProblem as error:
                raise locked or (error if size else BusyProblem(wait_s)) from None
            except TooHeavyError as error:
                size, ends_at = error.size, ends_at + MEMORY_WAIT_S
            except OperationalError as error:
                if not is_locked(error) or monotonic() >= ends_at:
                    raise
                lane, locked = self._locked, error
            finally:
                BYTES_IN_HAND.reset(token)
            await sleep(_PAUSE_S)


class Threads:
    """One process's lanes."""

    def __init__(self) -> None:
        self.memory = memory = Memory()
        locked = Lane(_LOCKED, 1)
        self.reading = Lane(_READERS, _READERS // 2, locked, memory)
        self.writing = Lane(_WRITERS, _WRITERS // 2, locked, memory)
        self.marking = Lane(_MARKING, 1, locked, memory)
        self.identity = Lane(_IDENTITY, _IDENTITY - 1)
        # Refused callers come again. 64 of them at once, every 4 s, blocked the event loop for half a second.
        self._parsers = ConcurrencyLimiter(_PARSERS, 1, MEMORY_WAIT_S)

    async def parse(self, call: Callable[..., ValueT], *args: Any, caller: UUID) -> ValueT:
        """Return the result of ``call``, which parses a request's body. A person has one such call at a time.

        Raises as :meth:`Lane.run`.
        """
        async with self._parsers.take(caller):
            return await self.reading.run(call, *args, caller=caller)
