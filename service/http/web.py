"""The built pages: files of ``service/web``, and the page itself for every address that the API does not have."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI, HTTPException
from fastapi.responses import FileResponse, HTMLResponse, Response
from starlette.types import Receive, Scope, Send

WEB = Path(__file__).parent.parent / "web"

_NOT_BUILT = """<!doctype html><title>apexcal</title><p>The service runs. Its pages are not built:
run <code>make frontend</code>, or install a wheel. The API is at <a href="/v1/openapi.json">/v1</a>."""


class Pages:
    """What the router asks when no route matches, so that the pages never hide a route or its methods."""

    def __init__(self, web: Path) -> None:
        self._root = web.resolve()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        path: str = scope["path"].lstrip("/")
        if scope["method"] not in ("GET", "HEAD") or path == "v1" or path.startswith("v1/"):
            raise HTTPException(404)
        await self._response(path)(scope, receive, send)

    def _response(self, path: str) -> Response:
        asked = self._file(path)
        if asked:
            # Vite names the files under assets/ by their content.
            forever = asked.is_relative_to(self._root / "assets")
            return FileResponse(
                asked, headers={"Cache-Control": "public, max-age=31536000, immutable" if forever else "no-cache"}
            )
        if path.startswith("assets/"):
            raise HTTPException(404)
        index = self._root / "index.html"
        if not index.is_file():
            return HTMLResponse(_NOT_BUILT)
        return FileResponse(index, headers={"Cache-Control": "no-cache"})

    def _file(self, path: str) -> Path | None:
        """The file at this address, where there is one; what no file can be called is none."""
        try:
            asked = (self._root / path).resolve()
            is_ours = asked.is_relative_to(self._root) and asked.is_file() and asked.name != "index.html"
        except (OSError, ValueError):  # longer than names may be; with a NUL
            return None
        return asked if is_ours else None


def install(app: FastAPI, web: Path = WEB) -> None:
    """Serve the pages from ``web`` under every GET address that no route has."""
    app.router.default = Pages(web)
