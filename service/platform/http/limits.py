"""A concurrency limiter: how many requests or bytes of one kind are served at once, and how many are one person's."""

from __future__ import annotations

from asyncio import Lock, Semaphore, timeout
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from uuid import UUID
from weakref import WeakValueDictionary

from starlette.requests import Request

from service.platform.http.problems import Problem


class BusyProblem(Problem):
    """The answer if a request got no place in time."""

    def __init__(self, wait_s: float) -> None:
        super().__init__(
            503,
            "busy",
            f"For {wait_s:g} s as many requests like this one were under way as the service takes at once.",
            "Send it again in a few seconds; nothing of it was done.",
            headers={"Retry-After": "2"},
        )


class _Places(Semaphore):
    """A semaphore whose places a request takes in one turn: two with half of theirs would wait for ever."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        self.count = count
        self._turn = Lock()

    async def take(self, stack: AsyncExitStack, count: int) -> None:
        """Take ``count`` places until the stack ends; all of them if there are fewer."""
        async with self._turn:
            for _ in range(max(min(count, self.count), 1)):
                await stack.enter_async_context(self)


class ConcurrencyLimiter:
    """``total`` places in one event loop, of which one person may hold ``each``."""

    def __init__(self, total: int, each: int | None = None, wait_s: float = 0.0) -> None:
        self._total = _Places(total)
        self._each = each
        self._wait_s = wait_s
        self._of_persons: WeakValueDictionary[UUID, _Places] = WeakValueDictionary()

    @asynccontextmanager
    async def take(self, person_id: UUID | None, wait_s: float | None = None, count: int = 1) -> AsyncIterator[None]:
        """Hold ``count`` places for a block.

        Raises :class:`BusyProblem` after ``wait_s`` seconds, by default those of the limiter.
        """
        wait_s = self._wait_s if wait_s is None else wait_s
        async with AsyncExitStack() as stack:
            try:
                async with timeout(wait_s):
                    if self._each is not None and person_id is not None:
                        count = min(count, self._each)
                        own = self._of_persons.setdefault(person_id, _Places(self._each))
                        await own.take(stack, count)
                    await self._total.take(stack, count)
            except TimeoutError:
                raise BusyProblem(wait_s) from None
            yield


def declared_length(request: Request) -> int | None:
    """Return the length of a request's body by its header; None without one."""
    text = request.headers.get("content-length", "")
    return int(text) if text.isascii() and text.isdigit() else None
