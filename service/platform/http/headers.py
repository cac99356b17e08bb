"""Headers of every answer: nothing of another site runs in our pages, and nothing is cached that may change."""

from __future__ import annotations

from collections.abc import Sequence

from starlette.types import ASGIApp, Message, Receive, Scope, Send

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


class SafeHeaders:
    """Pure ASGI middleware, so that streams pass through it untouched.

    ``stores`` are the origins that pages may send parts to and fetch frames from beside the service's own.
    """

    def __init__(self, app: ASGIApp, stores: Sequence[str] = ()) -> None:
        self._app = app
        connect = " ".join(("; connect-src 'self'", *stores)) if stores else ""
        always = {"Content-Security-Policy": CONTENT_SECURITY_POLICY + connect, **_ALWAYS}
        self._pages = [(name.lower().encode(), value.encode()) for name, value in always.items()]
        self._api = [*self._pages, (b"cache-control", b"private, no-cache")]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = {name for name, _ in message.get("headers", ())}
                ours = self._api if scope["path"].startswith("/v1/") else self._pages
                message["headers"] = [*message.get("headers", ()), *(one for one in ours if one[0] not in given)]
            await send(message)

        await self._app(scope, receive, send_with_headers)
