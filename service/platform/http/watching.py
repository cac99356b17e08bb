"""Every request gets a line in the log and a place in the figures."""

from __future__ import annotations

import logging
import time
from urllib.parse import quote

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.platform.http.figures import HttpFigures

# Machines ask these every few seconds: they are counted but not logged.
_UNLOGGED = frozenset(("/healthz", "/readyz", "/metrics"))
_API = "/v1/"
# Our addresses have at most 250 letters; longer ones are cut, so that strangers cannot fill the log.
_LONGEST_PATH = 500
# nginx's number for a client that left before its answer began.
_CLIENT_LEFT = 499

log = logging.getLogger(__name__)


class Watched:
    """Pure ASGI middleware, so that streams pass untouched. Only what gives a request its id stands around it."""

    def __init__(self, app: ASGIApp, figures: HttpFigures) -> None:
        self._app = app
        self._figures = figures

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        status = _CLIENT_LEFT

        async def send_noting(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        with self._figures.in_flight.track_inprogress():
            try:
                await self._app(scope, receive, send_noting)
            except Exception:
                status = 500
                raise
            finally:
                self._note(scope, status, time.perf_counter() - began)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        self._figures.answered(scope["method"], route_of(scope), status, seconds)
        if scope["path"] not in _UNLOGGED:
            path = quote(scope["path"])[:_LONGEST_PATH]
            what = {"method": scope["method"], "path": path, "status": status}
            text = "%s %s %d in %.0f ms"
            log.info(text, *what.values(), seconds * 1000, extra={**what, "ms": round(seconds * 1000, 1)})


def route_of(scope: Scope) -> str:
    """The template of the route that answered, `pages` for what belongs to none."""
    path: str | None = getattr(scope.get("route"), "path", None)
    if not path:
        return "pages"
    # FastAPI keeps a router's own route; where it was mounted is not in its path.
    mounted = scope["path"].startswith(_API) and not path.startswith(_API)
    return _API.rstrip("/") + path if mounted else path
