"""Credentials before bodies: no byte of an unknown sender's body is read."""

from __future__ import annotations

from fastapi.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from service.auth.access import identify, keep_identity

# No request with one of these methods has its body read.
_WITHOUT_BODY = frozenset(("GET", "HEAD", "OPTIONS"))
# Who signs in has no credentials yet; the route itself limits the body to a few KiB.
_OPEN = frozenset((("POST", "/v1/sign-in"),))


class Gate:
    """ASGI middleware around the router. It stands inside the error handling, so refusals become problems."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, or raise what :func:`identify` raises."""
        if scope["type"] == "http" and scope["method"] not in _WITHOUT_BODY and not _is_open(scope):
            keep_identity(scope, await run_in_threadpool(identify, Request(scope)))
        await self._app(scope, receive, send)


def _is_open(scope: Scope) -> bool:
    return (scope["method"], scope["path"]) in _OPEN
