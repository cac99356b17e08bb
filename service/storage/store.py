"""Bytes by key, in a local folder or in S3, through one code path (obstore).

An object is durable when a call that writes it returns, so that a row may say that it is there. Keys are never
written twice: every writer makes its own (see ``service.storage.blobs``).
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

import obstore
from obstore.store import LocalStore, from_url

_STREAM_CHUNK = 4 * 1024 * 1024


class MissingBlobError(Exception):
    """The store holds no object of this key."""

    def __init__(self, key: str) -> None:
        super().__init__(f"the blob store holds no object {key!r}")
        self.key = key


class Store:
    """The blob store behind ``url``: ``file:///folder`` or ``s3://bucket/prefix``."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self.folder: Path | None = None
        if parts.scheme == "file":
            self.folder = Path(unquote(parts.path))
            self._store = LocalStore(self.folder, mkdir=True)
        else:
            self._store = from_url(url)

    def free_bytes(self) -> int | None:
        """Bytes left on the disk of a local store; None where the store does not say."""
        return shutil.disk_usage(self.folder).free if self.folder else None

    async def put_stream(self, key: str, chunks: AsyncIterator[bytes]) -> None:
        """Write an object from a stream, never holding it whole."""
        await obstore.put_async(self._store, key, chunks)
        await asyncio.to_thread(self._make_durable, key)

    def put_file(self, key: str, path: Path) -> int:
        """Write an object from a file and return its size in bytes."""
        with path.open("rb") as file:
            obstore.put(self._store, key, file)
        self._make_durable(key)
        return path.stat().st_size

    def put_bytes(self, key: str, data: bytes) -> None:
        """Write a small object."""
        obstore.put(self._store, key, data)
        self._make_durable(key)

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """``length`` bytes of an object from ``start``. Raises :class:`MissingBlobError`."""
        try:
            return bytes(obstore.get_range(self._store, key, start=start, length=length))
        except FileNotFoundError:
            raise MissingBlobError(key) from None

    def stream(self, key: str) -> Iterator[bytes]:
        """An object's bytes in chunks of a few MiB. Raises :class:`MissingBlobError`."""
        try:
            found = obstore.get(self._store, key)
        except FileNotFoundError:
            raise MissingBlobError(key) from None
        for chunk in found.stream(min_chunk_size=_STREAM_CHUNK):
            yield bytes(chunk)

    def delete(self, key: str) -> None:
        """Remove an object, and what an interrupted write of it left. A missing one is no error."""
        with contextlib.suppress(FileNotFoundError):
            obstore.delete(self._store, key)
        if self.folder:
            staged = self.folder / key
            for left in staged.parent.glob(f"{staged.name}#*"):
                left.unlink(missing_ok=True)

    def local_path(self, key: str) -> Path | None:
        """The file that holds the object, where the store is a folder: reading it saves a copy."""
        path = self.folder / key if self.folder else None
        return path if path and path.exists() else None

    def _make_durable(self, key: str) -> None:
        # obstore renames a staged file into place but does not flush it; S3 answers when it is durable.
        if not self.folder:
            return
        path = self.folder / key
        for target in (path, *path.relative_to(self.folder).parents):
            descriptor = os.open(self.folder / target, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
