"""The envelope of every request: its id, its line in the log, its part of the figures, and the headers of its answer.

The headers keep other sites' scripts out of our pages, and changing answers out of caches.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from urllib.parse import quote

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.platform.http.draining import Drain
from service.platform.http.figures import HttpFigures
from service.platform.http.problems import MEDIA_TYPE, too_large
from service.platform.observability import logs, request_ids

# Parts of an upload are hashed by WebAssembly in a worker; `wasm-unsafe-eval` allows that and no evaluated script.
CONTENT_SECURITY_POLICY = (
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' blob: data:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_ALWAYS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_PROBLEM = (b"content-type", MEDIA_TYPE.encode())
# Machines request these every few seconds: they are counted but not logged.
_UNLOGGED = frozenset(("/healthz", "/readyz", "/metrics"))
# Our addresses have at most 250 letters; longer ones are cut, so that strangers cannot fill the log.
_LONGEST_PATH = 500
# nginx's number for a client that left before its answer began.
_CLIENT_LEFT = 499

log = logging.getLogger(__name__)


class _HeadSentError(Exception):
    """A HEAD has its answer: the rest, which would produce the content, is skipped."""


class Envelope:
    """Pure ASGI middleware, so that streams pass unchanged; one layer, because each layer costs every request.

    ``stores`` are further origins that pages may send parts to and fetch frames from.
    """

    def __init__(self, app: ASGIApp, figures: HttpFigures, drain: Drain, stores: Sequence[str] = ()) -> None:
        self._app = app
        self._figures = figures
        self._drain = drain
        connect = " ".join(("; connect-src 'self'", *stores)) if stores else ""
        always = {"Content-Security-Policy": CONTENT_SECURITY_POLICY + connect, **_ALWAYS}
        self._pages = [(name.lower().encode(), value.encode()) for name, value in always.items()]
        self._api = [*self._pages, (b"cache-control", b"private, no-cache")]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        request_id = request_ids.bind(scope["headers"])
        logs.say_who(address=(scope.get("client") or ("",))[0])
        status, is_no_problem = _CLIENT_LEFT, False
        # HEAD is answered as GET is, without the content: routes see a GET.
        is_head = scope["method"] == "HEAD"
        inner = {**scope, "method": "GET"} if is_head else scope

        async def send_on(message: Message) -> None:
            nonlocal status, is_no_problem
            if message["type"] == "http.response.start":
                status, headers = message["status"], message.get("headers", ())
                # The framework refuses a body of too many bytes with plain text.
                is_no_problem = status == 413 and _PROBLEM not in headers
                message["headers"] = self._with_standard_headers(scope["path"], headers, request_id)
            elif is_head:
                await send({"type": "http.response.body"})
                raise _HeadSentError
            if not is_no_problem:
                await send(message)

        with self._figures.in_flight.track_inprogress():
            try:
                await self._app(inner, receive, send_on)
                if is_no_problem:
                    await too_large().response()(scope, receive, send_on)
            except _HeadSentError:
                pass
            except Exception:
                status = 500
                raise
            finally:
                self._note({**inner, "method": scope["method"]}, status, time.perf_counter() - began)

    def _with_standard_headers(
        self, path: str, headers: Sequence[tuple[bytes, bytes]], request_id: str
    ) -> list[tuple[bytes, bytes]]:
        ours = self._api if path.startswith("/v1/") else self._pages
        if self._drain.asked:
            headers = [header for header in headers if header[0] != b"connection"]
            ours = [*ours, (b"connection", b"close")]
        names = {name for name, _ in headers}
        named = (request_ids.HEADER.encode(), request_id.encode())
        return [*headers, *(header for header in ours if header[0] not in names), named]

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "path", None) or "pages"
        self._figures.answered(scope["method"], route, status, seconds)
        # Cars that are up to date ask again and again: 500 such lines a second fill 30 MB within two minutes.
        if scope["path"] not in _UNLOGGED and status != 304:
            path = quote(scope["path"])[:_LONGEST_PATH]
            what = {"method": scope["method"], "path": path, "status": status}
            text = "%s %s %d in %.0f ms"
            log.info(text, *what.values(), seconds * 1000, extra={**what, "ms": round(seconds * 1000, 1)})
