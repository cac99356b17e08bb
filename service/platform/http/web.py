"""The built pages: files of ``service/web``, and the page itself for every address that the API does not have."""

from __future__ import annotations

import re
from mimetypes import guess_type
from pathlib import Path

from fastapi import FastAPI, HTTPException
from fastapi.responses import FileResponse, HTMLResponse, Response
from starlette.datastructures import Headers
from starlette.types import Receive, Scope, Send

WEB = Path(__file__).parents[2] / "web"

# The build compresses a file once for each of these, the smallest first. Browsers take `br` over https alone.
_COMPRESSED = {"br": ".br", "gzip": ".gz"}

_NOT_BUILT = """<!doctype html><title>apexcal</title><p>The service runs. Its pages are not built:
run <code>make frontend</code>, or install a wheel. The API is at <a href="/v1/openapi.json">/v1</a>."""


class Pages:
    """The answer if no route matches, so that the pages never hide a route or its methods."""

    def __init__(self, web: Path) -> None:
        self._root = web.resolve()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        path: str = scope["path"].lstrip("/")
        # If a proxy adds a prefix, a program that requests /prefix/v1 must not get a page.
        if scope["method"] not in ("GET", "HEAD") or "v1" in path.split("/"):
            raise HTTPException(404)
        headers = Headers(scope=scope)
        takes_pages = _accepts(headers.get("accept", ""), "text/html")
        response = self._response(path, headers.get("accept-encoding", ""), takes_pages=takes_pages)
        await response(scope, receive, send)

    def _response(self, path: str, encodings: str, *, takes_pages: bool) -> Response:
        page = self._file(path)
        if page is None and (path.startswith("assets/") or not takes_pages):
            raise HTTPException(404)
        file = page or self._root / "index.html"
        if not file.is_file():
            return HTMLResponse(_NOT_BUILT)
        # Vite names the files under assets/ by their content.
        forever = file.is_relative_to(self._root / "assets")
        headers = {
            "Cache-Control": "public, max-age=31536000, immutable" if forever else "no-cache",
            "Vary": "Accept-Encoding" if page else "Accept, Accept-Encoding",
        }
        media_type = guess_type(file.name)[0] or "application/octet-stream"
        for encoding, suffix in _COMPRESSED.items():
            compressed = file.with_name(file.name + suffix)
            if _accepts(encodings, encoding) and compressed.is_file():
                # The ETag is of the compressed file: each encoding has its own.
                return FileResponse(
                    compressed, headers={**headers, "Content-Encoding": encoding}, media_type=media_type
                )
        return FileResponse(file, headers=headers, media_type=media_type)

    def _file(self, path: str) -> Path | None:
        """Return the file at this address; None if there is none, or no file can have that name."""
        try:
            file = (self._root / path).resolve()
            is_ours = file.is_relative_to(self._root) and file.is_file() and file.name != "index.html"
            is_ours = is_ours and file.suffix not in _COMPRESSED.values()
        except (OSError, ValueError):  # longer than names may be; with a NUL
            return None
        return file if is_ours else None


def _accepts(header: str, token: str) -> bool:
    """Return whether an Accept or Accept-Encoding header lists ``token`` with a weight above 0."""
    for choice in header.lower().split(","):
        name, _, weight = (part.strip() for part in choice.partition(";"))
        if name == token:
            return not re.fullmatch(r"q=0(\.0*)?", weight)
    return False


def install(app: FastAPI, web: Path = WEB) -> None:
    """Serve the pages from ``web`` under every GET address that no route has."""
    app.router.default = Pages(web)
