"""The threads in which an API process asks the database, and how many of each kind there are."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import anyio.to_thread
from anyio import CapacityLimiter

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
# Threads outside of these limits: three parts of /readyz and the reader of vehicles' states.
_OUTSIDE = 4
# A connection for each thread: nobody waits for one.
CONNECTIONS = _READERS + _WRITERS + _MARKING + _IDENTITY + OTHERS + _OUTSIDE
# A row is locked for milliseconds. Longer than this no request waits for one: 503 with Retry-After.
LOCK_S = 5

ValueT = TypeVar("ValueT")


class Threads:
    """One process's threads, by what is done in them."""

    def __init__(self) -> None:
        self.reading = CapacityLimiter(_READERS)
        self.writing = CapacityLimiter(_WRITERS)
        self.marking = CapacityLimiter(_MARKING)
        self.identity = CapacityLimiter(_IDENTITY)


async def in_thread(limiter: CapacityLimiter, call: Callable[..., ValueT], *args: object, **named: object) -> ValueT:
    """What ``call`` returns, called in a thread of ``limiter``."""
    return await anyio.to_thread.run_sync(partial(call, *args, **named), limiter=limiter)
