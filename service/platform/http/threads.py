"""The threads in which an API process asks the database, and how many of each kind there are."""

from __future__ import annotations

import math
from asyncio import sleep
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any, TypeVar
from uuid import UUID

from anyio import CapacityLimiter
from anyio.to_thread import run_sync
from sqlalchemy.exc import OperationalError

from service.platform.http.limits import BusyProblem, ConcurrencyLimiter
from service.platform.http.problems import is_locked

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
# All else, such as imported pairs and upkeep. It is anyio's own limit, 40 by default.
OTHERS = 6
# A connection for each thread: nobody waits for one.
CONNECTIONS = _READERS + _WRITERS + _MARKING + _IDENTITY + _LOCKED + OTHERS
# So long does a request wait for threads and locks together. Rows are locked for milliseconds. Sixty who wait for one
# row ask within a second and hear within half a second, so that the last has its answer well before 6 s.
WAIT_S = 4.0
# So long does one try wait for one lock. PostgreSQL may let a statement wait twice for a row: behind others who wait,
# then for its holder.
LOCK_S = 0.1
# Between two tries, in case the database refuses a lock at once.
_PAUSE_S = 0.02

ValueT = TypeVar("ValueT")

# A lane has counted the thread already.
_ANY = CapacityLimiter(math.inf)


class Lane:
    """Threads for one kind of work; one person holds ``each`` of them at most.

    ``locked`` is the lane of those that found a row locked.
    """

    def __init__(self, threads: int, each: int | None = None, locked: Lane | None = None) -> None:
        self._limiter = ConcurrencyLimiter(threads, each)
        self._locked = locked or self

    async def run(
        self,
        call: Callable[..., ValueT],
        *args: Any,
        caller: UUID | None = None,
        wait_s: float = WAIT_S,
        **named: Any,
    ) -> ValueT:
        """Return what ``call`` returns, called in a thread. It commits once at most, and last of all.

        Where it finds a lock held, it is rolled back and leaves its thread to others. Then it is called again, in the
        lane for that.

        Raises:
            BusyProblem: no thread was free for ``wait_s`` seconds.
            OperationalError: a lock was held for so long, threads' waiting included; or what ``call`` raises.
        """
        ends_at, lane, locked = monotonic() + wait_s, self, None
        while True:
            try:
                async with lane._limiter.take(caller, ends_at - monotonic()):
                    return await run_sync(partial(call, *args, **named), limiter=_ANY)
            except BusyProblem:
                raise locked or BusyProblem(wait_s) from None
            except OperationalError as error:
                if not is_locked(error) or monotonic() >= ends_at:
                    raise
                lane, locked = self._locked, error
            await sleep(_PAUSE_S)


class Threads:
    """One process's threads, by what is done in them."""

    def __init__(self) -> None:
        locked = Lane(_LOCKED, 1)
        self.reading = Lane(_READERS, locked=locked)
        self.writing = Lane(_WRITERS, _WRITERS // 2, locked)
        self.marking = Lane(_MARKING, 1, locked)
        self.identity = Lane(_IDENTITY)
