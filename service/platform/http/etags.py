"""Conditional requests: a read that has not changed is answered 304, an edit of an old version 412."""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
from typing import Annotated, Any

from fastapi import Depends, FastAPI, Request, Response

from service.platform.http.problems import Problem


class NotModified(Exception):  # noqa: N818 - an answer, not an error
    """The client has this version already."""

    def __init__(self, etag: str) -> None:
        super().__init__(etag)
        self.etag = etag


def version_etag(version: int) -> str:
    """Return the entity tag of a row that counts its versions."""
    return f'"v{version}"'


def content_etag(digest: str) -> str:
    """Return the entity tag of something named by a hash of its content."""
    return f'"{digest}"'


def repr_digest(content: bytes) -> dict[str, str]:
    """Return the header by which a client checks that all bytes arrived (RFC 9530)."""
    return {"Repr-Digest": f"sha-256=:{b64encode(sha256(content).digest()).decode()}:"}


class Conditions:
    """The request's If-Match and If-None-Match, and the answer's ETag."""

    def __init__(self, request: Request, response: Response) -> None:
        self._request = request
        self._response = response

    def offer(self, etag: str, *, more_changes: bool = False) -> None:
        """Put ``etag`` on the answer. Raises :class:`NotModified` if a read names it in If-None-Match.

        ``more_changes``: the answer also holds data that the tag does not cover, such as a job's progress. The tag
        then serves edits only.
        """
        self._response.headers["ETag"] = etag
        if more_changes:
            return
        if self._request.method in ("GET", "HEAD") and names(self._request.headers.get("if-none-match"), etag):
            raise NotModified(etag)

    def require(self, etag: str) -> None:
        """Raises :class:`Problem` unless the edit names the present version ``etag`` in If-Match."""
        header = self._request.headers.get("if-match")
        if header is None:
            raise Problem(
                428,
                "if_match_required",
                "This edit does not say which version it changes.",
                "Read the resource and send its ETag as If-Match.",
            )
        if not names(header, etag):
            raise Problem(
                412,
                "version_conflict",
                f"Somebody changed this meanwhile: it is {etag} now, and the edit was made on {header}.",
                "Read it again, decide whether your change still holds, and send it with the new ETag.",
            )

    def edit(self, row: Any) -> None:
        """Give a row its next version, and the answer its new ETag. Raises :class:`Problem` as :meth:`require`."""
        self.require(version_etag(row.version))
        row.version += 1
        self.offer(version_etag(row.version))

    def creates_only(self) -> bool:
        """Whether the request may only create (If-None-Match: *)."""
        return self._request.headers.get("if-none-match", "").strip() == "*"


def names(header: str | None, etag: str) -> bool:
    """Return whether a header of entity tags holds ``etag``."""
    if header is None:
        return False
    # If-None-Match compares weakly: proxies that compress make W/"v3" of "v3".
    tags = [tag.strip().removeprefix("W/") for tag in header.split(",")]
    return "*" in tags or etag in tags


def install(app: FastAPI) -> None:
    """Answer :class:`NotModified` with 304."""

    @app.exception_handler(NotModified)
    async def on_not_modified(request: Request, error: NotModified) -> Response:
        return Response(status_code=304, headers={"ETag": error.etag, "Cache-Control": "private, no-cache"})


async def conditions(request: Request, response: Response) -> Conditions:
    """Return the request's conditions."""
    # A coroutine runs in place; a plain function would go through the thread pool.
    return Conditions(request, response)


Conditional = Annotated[Conditions, Depends(conditions)]
