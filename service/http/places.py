"""Limits how many requests that cost memory are served at once; the next one waits a moment."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from uuid import UUID

from service.http.problems import Problem


class Places:
    """``total`` places in this process, of which one person has at most ``each``.

    Who finds none waits ``patience_s`` seconds at most. Used from one event loop.
    """

    def __init__(self, total: int, each: int, patience_s: float) -> None:
        self._total = total
        self._each = each
        self._patience_s = patience_s
        self._held: Counter[UUID] = Counter()
        self._waiting: list[asyncio.Event] = []

    @asynccontextmanager
    async def take(self, person_id: UUID) -> AsyncIterator[None]:
        """Hold a place. Raises :class:`Problem` 503 ``busy``."""
        try:
            async with asyncio.timeout(self._patience_s):
                while not self._has_one_for(person_id):
                    await self._change()
        except TimeoutError:
            raise _busy() from None
        self._held[person_id] += 1
        try:
            yield
        finally:
            self._held[person_id] -= 1
            self._held += Counter()  # forgets who holds none
            for one in self._waiting:
                one.set()

    def _has_one_for(self, person_id: UUID) -> bool:
        return self._held.total() < self._total and self._held[person_id] < self._each

    async def _change(self) -> None:
        changed = asyncio.Event()
        self._waiting.append(changed)
        try:
            await changed.wait()
        finally:
            self._waiting.remove(changed)


def _busy() -> Problem:
    return Problem(
        503,
        "busy",
        "The service is at work on as many requests of this size as its memory allows.",
        "Send the request again in a few seconds.",
        headers={"Retry-After": "5"},
    )
