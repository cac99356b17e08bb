"""Checks credentials before a body is read, and limits how many requests a person sends at once."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from uuid import UUID

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.platform.auth.access import identified
from service.platform.http.problems import Problem

# No request with one of these methods has its body read.
_WITHOUT_BODY = frozenset(("GET", "HEAD", "OPTIONS"))
# Who signs in has no credentials yet; the route itself limits the body to a few KiB.
_OPEN = frozenset((("POST", "/v1/sign-in"),))
# Seconds for a stranger's body of 4 KiB, and how many may be on their way in a process; the oldest makes room. A
# thousand that come at once wait for a second to be taken, and shall all have ended within 5 s.
STRANGER_S = 3.0
STRANGERS = 64
# A body may come slowly. Each holds a connection, of which a process takes a thousand, and a part of an upload holds
# room on the disk. A program that sends parts and asks for work has a dozen requests under way.
_OF_A_PERSON = 64


class Gate:
    """ASGI middleware around the router. It stands inside the error handling, so refusals become problems."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._under_way: Counter[UUID] = Counter()
        self._strangers: list[asyncio.Timeout] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request. Raises what :func:`identify` raises, and :class:`Problem` 429 ``too_many_at_once``."""
        if scope["type"] != "http" or scope["method"] in _WITHOUT_BODY:
            await self._app(scope, receive, send)
            return
        if _is_open(scope):
            await self._serve_stranger(scope, receive, send)
            return
        identity = await identified(Request(scope))
        with self._counted(identity.person.id):
            await self._app(scope, receive, send)

    async def _serve_stranger(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request that names nobody. Raises :class:`Problem` 408 ``body_too_slow``."""
        try:
            async with asyncio.timeout(STRANGER_S) as deadline:
                self._strangers.append(deadline)
                if len(self._strangers) > STRANGERS:
                    self._release(self._strangers[0], 0.0)

                async def receive_in_time() -> Message:
                    message = await receive()
                    if not message.get("more_body"):  # what the service does with it has its own limits
                        self._release(deadline)
                    return message

                try:
                    await self._app(scope, receive_in_time, send)
                finally:
                    self._release(deadline)
        except TimeoutError:
            raise _too_slow() from None

    def _release(self, deadline: asyncio.Timeout, ends_at: float | None = None) -> None:
        if deadline in self._strangers:
            self._strangers.remove(deadline)
        with suppress(RuntimeError):  # it has passed already
            deadline.reschedule(ends_at)

    @contextmanager
    def _counted(self, person_id: UUID) -> Iterator[None]:
        if self._under_way[person_id] >= _OF_A_PERSON:
            raise _too_many()
        self._under_way[person_id] += 1
        try:
            yield
        finally:
            self._under_way[person_id] -= 1
            self._under_way += Counter()  # forgets who has none


def _is_open(scope: Scope) -> bool:
    return (scope["method"], scope["path"]) in _OPEN


def _too_slow() -> Problem:
    return Problem(
        408,
        "body_too_slow",
        f"The request's body did not arrive within {STRANGER_S:g} s, or others came meanwhile.",
        "Send the request again, with its whole body.",
        headers={"Connection": "close"},
    )


def _too_many() -> Problem:
    return Problem(
        429,
        "too_many_at_once",
        f"You have {_OF_A_PERSON} requests under way that change something, which is the most for one person.",
        "Wait for the answers of some of them, then send this one again.",
        headers={"Retry-After": "1"},
    )
