"""The threads in which an API process asks the database, and how many of each kind there are."""

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

# Who reads waits for no lock, so these are never all held by who waits for one.
_READERS = 8
_WRITERS = 6
# Handing out and answering marking tasks is bound by the processor. Of 44 people's requests, three at once were
# answered as fast as forty, and those of others ten times sooner (p95 27 ms instead of 217).
_MARKING = 3
# Who asks is one look at the database; no body and no lock is waited for in between.
_IDENTITY = 3
# Those that got a lock too late once: rows that somebody holds for long have no more threads than these.
_LOCKED = 2
# So many readers parse what came with a request, such as a file of 60 kB, for up to 0.4 s each.
_PARSERS = 2
# Those with more than 8 MiB in hand. Three sets of 100,000 pairs at once, of three people; four calls at most.
_HEAVY = 4
_HEAVY_MIB = 216
# Those with less: most wait for who sends or takes bytes, such as 4 MiB of a frame.
_LIGHT = 64
# All else, such as upkeep. It is anyio's own limit, 40 by default.
OTHERS = 6
# A connection for each thread: nobody waits for one.
CONNECTIONS = _READERS + _WRITERS + _MARKING + _IDENTITY + _LOCKED + _HEAVY + OTHERS
# So long does a request wait for threads and locks together. Rows are locked for milliseconds. Sixty who wait for one
# row ask within a second and hear within half a second, so that the last has its answer well before 6 s.
WAIT_S = 4.0
# So long for memory and for parsers. Clients and proxies wait longer for an answer.
MEMORY_WAIT_S = 30.0
# So long does one try wait for one lock. PostgreSQL may let a statement wait twice for a row: behind others who wait,
# then for its holder.
LOCK_S = 0.1
# So long does a thread that computes keep the interpreter from others. A request comes back to it some 25 times: with
# Python's own 5 ms it took 0.13 s beside one that parses.
SWITCH_S = 0.0005
# Between two tries, in case the database refuses a lock at once.
_PAUSE_S = 0.02

ValueT = TypeVar("ValueT")

# A lane has counted the thread already.
_ANY = CapacityLimiter(math.inf)


class Memory:
    """Bytes that all requests of a process may have in hand, beside what any request takes."""

    def __init__(self) -> None:
        self._light = ConcurrencyLimiter(_LIGHT, _LIGHT // 4, MEMORY_WAIT_S)
        self._heavy = ConcurrencyLimiter(_HEAVY_MIB, _HEAVY_MIB // 3, MEMORY_WAIT_S)

    def take(self, person_id: UUID | None, size: int) -> AbstractAsyncContextManager[None]:
        """Have ``size`` bytes for a block. It raises :class:`BusyProblem` after :data:`MEMORY_WAIT_S`."""
        if size <= LIGHT_BYTES:
            return self._light.take(person_id)
        return self._heavy.take(person_id, count=max(size // MIB + 1, _HEAVY_MIB // _HEAVY))


class Lane:
    """Threads for one kind of work; one person holds ``each`` of them at most.

    ``locked`` is the lane of those that found a row locked. Calls that need much ``memory`` are made again where
    they have it, in none of these threads.
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
        """Return what ``call`` returns, called in a thread. It commits once at most, and last of all.

        Where it finds a lock held, or needs much memory, it is rolled back and leaves its thread to others. Then it
        is called again, in the lane for that or where it has the memory.

        Raises:
            BusyProblem: no thread was free for ``wait_s`` seconds.
            OperationalError: a lock was held for so long, threads' waiting included; or what ``call`` raises.
        """
        ends_at, lane, locked, size = monotonic() + wait_s, self, None, 0
        while True:
            room = self._memory.take(caller, size) if size else lane._limiter.take(caller, ends_at - monotonic())
            token = BYTES_IN_HAND.set(size)
            try:
                async with room:
                    return await run_sync(partial(call, *args, **named), limiter=_ANY)
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
    """One process's threads, by what is done in them."""

    def __init__(self) -> None:
        self.memory = memory = Memory()
        locked = Lane(_LOCKED, 1)
        self.reading = Lane(_READERS, _READERS // 2, locked, memory)
        self.writing = Lane(_WRITERS, _WRITERS // 2, locked, memory)
        self.marking = Lane(_MARKING, 1, locked, memory)
        self.identity = Lane(_IDENTITY, _IDENTITY - 1)
        # Who is refused comes again: 64 at once, every 4 s, kept the event loop from others for half a second.
        self._parsers = ConcurrencyLimiter(_PARSERS, 1, MEMORY_WAIT_S)

    async def parse(self, call: Callable[..., ValueT], *args: Any, caller: UUID) -> ValueT:
        """Return what ``call`` returns, which reads bytes that came with a request. One of a person is read at once.

        Raises as :meth:`Lane.run`.
        """
        async with self._parsers.take(caller):
            return await self.reading.run(call, *args, caller=caller)
