"""The threads in which an API process asks the database, and how many of each kind there are."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AsyncExitStack
from functools import partial
from typing import Any, TypeVar
from uuid import UUID
from weakref import WeakValueDictionary

from anyio import CapacityLimiter, fail_after
from anyio.to_thread import run_sync

from service.http.problems import Problem

# Who reads waits for no lock, so these are never all held by who waits for one.
_READERS = 8
# Each may wait for a lock. A waiter needs nothing but its own thread and connection until it commits.
_WRITERS = 8
# Handing out and answering marking tasks is bound by the processor. Of 44 people's requests, three at once were
# answered as fast as forty, and those of others ten times sooner (p95 27 ms instead of 217).
_MARKING = 3
# Who asks is one look at the database; no body and no lock is waited for in between.
_IDENTITY = 3
# All else, such as dependencies, imported pairs, upkeep. It is anyio's own limit, 40 by default.
OTHERS = 6
# Threads outside of these limits: three parts of /readyz.
_OUTSIDE = 3
# A connection for each thread: nobody waits for one.
CONNECTIONS = _READERS + _WRITERS + _MARKING + _IDENTITY + OTHERS + _OUTSIDE
# A row is locked for milliseconds. Longer than this no request waits for one, nor for a thread: 503 with Retry-After.
LOCK_S = 5

# So many of a kind does one person hold at most: if all theirs wait for one lock, others still write.
_SHARES = {"writing": 4, "marking": 1}

ValueT = TypeVar("ValueT")


class Lane:
    """Threads for one kind of work; one caller holds ``share`` of them at most."""

    def __init__(self, threads: int, share: int | None = None) -> None:
        self._limiter = CapacityLimiter(threads)
        self._share = share
        self._shares: WeakValueDictionary[UUID, CapacityLimiter] = WeakValueDictionary()

    async def run(self, call: Callable[..., ValueT], *args: Any, caller: UUID | None = None, **named: Any) -> ValueT:
        """What ``call`` returns, called in a thread. Raises :class:`Problem` 503 ``busy`` after ``LOCK_S``."""
        async with AsyncExitStack() as held:
            try:
                with fail_after(LOCK_S):
                    if self._share is not None and caller is not None:
                        await held.enter_async_context(self._shares.setdefault(caller, CapacityLimiter(self._share)))
                    await held.enter_async_context(self._limiter)
            except TimeoutError:
                raise _busy() from None
            return await run_sync(partial(call, *args, **named), limiter=_ANY)


# A lane has counted the thread already.
_ANY = CapacityLimiter(math.inf)


class Threads:
    """One process's threads, by what is done in them."""

    def __init__(self) -> None:
        self.reading = Lane(_READERS)
        self.writing = Lane(_WRITERS, _SHARES["writing"])
        self.marking = Lane(_MARKING, _SHARES["marking"])
        self.identity = Lane(_IDENTITY)


def _busy() -> Problem:
    return Problem(
        503,
        "busy",
        f"Requests like this one have held all threads for them for {LOCK_S} s.",
        "Send it again in a few seconds; nothing of it was done.",
        headers={"Retry-After": "2"},
    )
