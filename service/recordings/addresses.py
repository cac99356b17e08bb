"""Addresses of bytes for clients: ranges of sensors' blobs, and addresses at the store where the operator wants them.

Nothing is parsed to answer with a byte range, and it never changes.
"""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from datetime import datetime, timedelta

from fastapi import Depends, Request, Response

from apexcal.documents.recordings import BlobAddress
from service.platform.auth.access import CurrentIdentity
from service.platform.db.clock import utc_now
from service.platform.http.etags import Conditions, content_etag
from service.platform.http.store_problems import streamed
from service.platform.http.threads import Threads
from service.platform.settings import Settings
from service.platform.storage.store import PIECE, Store


@dataclass(frozen=True)
class Presigner:
    """Signs for one answer; all its addresses end together, at ``expires_at``."""

    store: Store
    settings: Settings
    expires_at: datetime

    @classmethod
    def of(cls, request: Request) -> Presigner:
        """The one of this request's application."""
        settings: Settings = request.app.state.settings
        return cls(request.app.state.store, settings, utc_now() + timedelta(seconds=settings.presigned_s))

    @property
    def uploads(self) -> bool:
        """Whether parts go straight to the store."""
        return self.settings.uploads == "presigned" and self.store.signs

    @property
    def downloads(self) -> bool:
        """Whether frames and originals come straight from the store."""
        return self.settings.downloads == "presigned" and self.store.signs

    def upload(self, key: str, size: int) -> str:
        """Return the address at which this object of ``size`` bytes is put."""
        return self.store.sign_put(key, size, self.settings.presigned_s)

    def download(self, key: str) -> str | None:
        """Return the address at which this object is read; None if it goes through the API."""
        return self.store.sign_get(key, self.settings.presigned_s) if self.downloads else None


async def _in_pieces(request: Request, identity: CurrentIdentity) -> AsyncIterator[None]:
    threads: Threads = request.app.state.threads
    async with threads.memory.take(identity.person.id, 2 * PIECE):
        yield


# Of routes that send objects of the store: memory for two pieces until the answer is sent.
IN_PIECES = Depends(_in_pieces)

_FOREVER = "private, max-age=31536000, immutable"


@dataclass(frozen=True)
class ByteRange:
    """A range, looked up in a session that has ended, so that none is open while the store is asked."""

    key: str
    index: int
    offset: int
    length: int
    media_type: str

    @property
    def etag(self) -> str:
        """The range's entity tag. The blob's key belongs to this blob alone."""
        return content_etag(hashlib.sha256(f"{self.key}:{self.index}".encode()).hexdigest()[:32])

    async def answer(self, request: Request, conditions: Conditions) -> Response:
        """The bytes, or 304 if the client has them. No answer holds all bytes of a large range at once."""
        conditions.offer(self.etag)
        store: Store = request.app.state.store
        headers = {"ETag": self.etag, "Cache-Control": _FOREVER, "Content-Length": str(self.length)}
        return await streamed(store.read_all(self.key, self.offset, self.length), self.media_type, headers)

    def address(self, request: Request) -> BlobAddress:
        """Where the bytes are read straight from the store with a Range header, or that they are read here.

        It is an address, not a redirect, because the client must send the Range header to get only this part.
        """
        presigner = Presigner.of(request)
        return BlobAddress(
            url=presigner.download(self.key),
            expires_at=presigner.expires_at if presigner.downloads else None,
            offset=self.offset,
            length=self.length,
            media_type=self.media_type,
        )
