"""Limits how many requests of one kind are served at once, and how many of them are one person's."""

from __future__ import annotations

from asyncio import Semaphore, timeout
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from uuid import UUID
from weakref import WeakValueDictionary

from service.platform.http.problems import Problem


class BusyProblem(Problem):
    """As many requests of this kind as may be are under way, and none of them ended in time."""

    def __init__(self, wait_s: float) -> None:
        super().__init__(
            503,
            "busy",
            f"For {wait_s:g} s as many requests like this one were under way as the service takes at once.",
            "Send it again in a few seconds; nothing of it was done.",
            headers={"Retry-After": "2"},
        )


class ConcurrencyLimiter:
    """``total`` requests at once in this process, of which one person has ``each`` at most. Of one event loop."""

    def __init__(self, total: int, each: int | None = None, wait_s: float = 0.0) -> None:
        self._total = Semaphore(total)
        self._each = each
        self._wait_s = wait_s
        self._of_persons: WeakValueDictionary[UUID, Semaphore] = WeakValueDictionary()

    @asynccontextmanager
    async def take(self, person_id: UUID | None, wait_s: float | None = None) -> AsyncIterator[None]:
        """Be one of them. Raises :class:`BusyProblem` after ``wait_s`` seconds, by default those of the limiter."""
        wait_s = self._wait_s if wait_s is None else wait_s
        async with AsyncExitStack() as stack:
            try:
                async with timeout(wait_s):
                    if self._each is not None and person_id is not None:
                        own = self._of_persons.setdefault(person_id, Semaphore(self._each))
                        await stack.enter_async_context(own)
                    await stack.enter_async_context(self._total)
            except TimeoutError:
                raise BusyProblem(wait_s) from None
            yield
