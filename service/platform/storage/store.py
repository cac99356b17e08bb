"""Bytes by key, in a local folder or in S3, through one code path (obstore).

An object is durable when a call that writes it returns, so that a row may say that it is there. Keys are never
written twice: every writer makes its own (see ``service.platform.storage.blobs``). The service awaits, so that a slow
store holds none of its threads; workers call. Both raise the errors of ``service.platform.storage.errors`` and no
others.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import shutil
import time
from collections.abc import AsyncIterator, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

import obstore
from obstore.store import S3Store

from service.platform.settings import MIB, S3Options, Settings
from service.platform.storage.errors import MissingBlobError, StoreUnavailableError, translated
from service.platform.storage.lengths import signed
from service.platform.storage.urls import open_url

# A disk that is unmounted under a running service leaves an empty folder, where everything would seem to be missing.
MARKER = ".apexcal-store"
_SAYS = "Blobs of apexcal. Without this file the service takes the folder for one whose disk is not mounted.\n"
# Objects are read in ranges of this many bytes, each a request with its own time limit and repetitions.
_RANGE = 8 * MIB
# What the service sends of one object in a piece: while a client takes it, it and the next one are in memory.
PIECE = 2 * MIB
# Memory for one object on its way up: this many chunks at once. S3 takes 10,000 chunks of one object: 80 GiB.
_CHUNK = 8 * MIB
_CHUNKS_AT_ONCE = 4
# Removals failing in a row that mean that the store is away.
_AWAY = 3

log = logging.getLogger(__name__)


def is_marked(folder: Path) -> bool:
    """Whether the folder can be looked into and has its marker."""
    try:
        (folder / MARKER).stat()
    except OSError:
        return False
    return True


def mark(folder: Path) -> None:
    """Write the marker, unless it is there. It is durable when the folder's first object is."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARKER).write_text(_SAYS)


@dataclass(frozen=True)
class ListedObject:
    """An object as the store lists it; ``modified`` by the store's clock."""

    key: str
    size: int
    modified: datetime


class Store:
    """The blob store behind ``url``: ``file:///folder`` or ``s3://bucket/prefix``.

    A folder must have been prepared once: without its marker it is a store that is away, never one without objects.
    The marker is looked for around every write, before a removal, around a listing, and where an object is missing.
    """

    def __init__(self, url: str, s3: S3Options | None = None) -> None:
        self._s3 = s3 or S3Options()
        opened = open_url(url, self._s3)
        self.folder = opened.folder
        self.origin = opened.origin
        self._store = opened.store
        self._signer: S3Store | None = opened.signer

    @property
    def signs(self) -> bool:
        """Whether clients can be given presigned addresses, which a folder does not have."""
        return self._signer is not None

    def is_prepared(self) -> bool:
        """Whether the folder has its marker. A bucket answers for itself."""
        return not self.folder or is_marked(self.folder)

    def prepare(self) -> None:
        """Mark the folder as a store."""
        if self.folder:
            with translated(MARKER, writing=True):
                mark(self.folder)

    def free_bytes(self) -> int | None:
        """Bytes left on the disk of a local store; None where the store does not say."""
        with translated("(room)", writing=True):
            return shutil.disk_usage(self.folder).free if self.folder else None

    async def put_stream(self, key: str, chunks: AsyncIterator[bytes]) -> None:
        """Write an object from a stream, never holding it whole."""
        await self._require_marker_aside()
        with translated(key, writing=True):
            await obstore.put_async(self._store, key, chunks, chunk_size=_CHUNK, max_concurrency=_CHUNKS_AT_ONCE)
            await asyncio.to_thread(self._make_durable, key)

    def put_file(self, key: str, path: Path) -> int:
        """Write an object from a file and return its size in bytes."""
        self._require_marker()
        with path.open("rb") as file, translated(key, writing=True):
            obstore.put(self._store, key, file, chunk_size=_CHUNK, max_concurrency=_CHUNKS_AT_ONCE)
            self._make_durable(key)
        return path.stat().st_size

    def put_bytes(self, key: str, data: bytes) -> None:
        """Write a small object."""
        self._require_marker()
        with translated(key, writing=True):
            obstore.put(self._store, key, data)
            self._make_durable(key)

    async def copy(self, key: str, to: str) -> None:
        """Copy an object within the store; none of its bytes come here."""
        await self._require_marker_aside()
        async with self._reading_async(key):
            await obstore.copy_async(self._store, key, to)
            await asyncio.to_thread(self._make_durable, to)

    async def size(self, key: str) -> int:
        """An object's size in bytes."""
        async with self._reading_async(key):
            return int((await obstore.head_async(self._store, key))["size"])

    def get_range(self, key: str, start: int, length: int) -> bytes:
        """``length`` bytes of an object from ``start``, for workers."""
        with self._reading(key):
            data = bytes(obstore.get_range(self._store, key, start=start, length=length))
        return _whole(key, data, length)

    async def read_all(self, key: str, start: int = 0, length: int | None = None) -> AsyncIterator[bytes]:
        """Yield an object's bytes, or ``length`` of them from ``start``, :data:`PIECE` at a time."""
        end = start + (1 if length is None else length)
        while start < end:
            stop = start + PIECE if length is None else min(start + PIECE, end)
            async with self._reading_async(key):
                answer = await obstore.get_async(self._store, key, options={"range": (start, stop)})
                end = int(answer.meta["size"]) if length is None else end
                data = bytes(await answer.bytes_async())
            yield _whole(key, data, min(stop, end) - start)
            start += len(data)

    def stream(self, key: str) -> Iterator[bytes]:
        """:meth:`read_all` for workers."""
        start, size = 0, 1
        while start < size:
            with self._reading(key):
                answer = obstore.get(self._store, key, options={"range": (start, start + _RANGE)})
                size, data = int(answer.meta["size"]), bytes(answer.bytes())
            yield _whole(key, data, min(_RANGE, size - start))
            start += len(data)

    def sign_put(self, key: str, size: int, seconds: float) -> str:
        """The address at which anyone may put this object of ``size`` bytes for so long.

        Another size is refused, where the settings state the keys: :mod:`service.platform.storage.lengths`.
        """
        keys = self._s3.access_key_id, self._s3.secret_access_key
        return signed(self._sign("PUT", key, seconds), {"content-length": str(size)}, *keys)

    def sign_get(self, key: str, seconds: float) -> str:
        """The address at which anyone may read this object, or ranges of it, for so long."""
        return self._sign("GET", key, seconds)

    def list(self) -> Iterator[ListedObject]:
        """Every object that is there, in no order, also what interrupted writes left beside them in a folder."""
        self._require_marker()
        yield from self.list_unprepared()
        self._require_marker()

    def list_unprepared(self) -> Iterator[ListedObject]:
        """:meth:`list`, also of a folder that is no store yet."""
        with translated("(listing)", writing=True):
            for page in obstore.list(self._store):
                for meta in page:
                    if meta["path"] != MARKER:
                        yield ListedObject(meta["path"], int(meta["size"]), meta["last_modified"])
        for left in self.folder.rglob("*#*") if self.folder else ():
            with contextlib.suppress(FileNotFoundError):
                status = left.stat()
                modified = datetime.fromtimestamp(status.st_mtime, UTC)
                yield ListedObject(left.relative_to(self.folder or left).as_posix(), status.st_size, modified)

    def delete(self, key: str) -> None:
        """Remove an object, and what an interrupted write of it left. A missing one is no error."""
        self._require_marker()
        with contextlib.suppress(MissingBlobError), translated(key):
            if self.folder:
                staged = self.folder / key
                if "#" in staged.name:
                    staged.unlink(missing_ok=True)
                    return
                for left in staged.parent.glob(f"{staged.name}#*"):
                    left.unlink(missing_ok=True)
            obstore.delete(self._store, key)

    def delete_all(self, keys: Iterable[str], until: float = math.inf) -> tuple[list[str], list[str]]:
        """Remove objects, each whatever becomes of the others; returns the removed and the failed keys.

        It ends, with keys that are in neither, at ``until`` (:func:`time.monotonic`) and where three in a row fail:
        that is a store that is away.
        """
        removed: list[str] = []
        failed: list[str] = []
        in_a_row = 0
        for key in keys:
            if in_a_row == _AWAY or time.monotonic() >= until:
                break
            try:
                self.delete(key)
            except StoreUnavailableError:
                failed.append(key)
                in_a_row += 1
            else:
                removed.append(key)
                in_a_row = 0
        return removed, failed

    def local_path(self, key: str) -> Path | None:
        """The file that holds the object, where the store is a folder: reading it saves a copy."""
        path = self.folder / key if self.folder else None
        return path if path and path.exists() else None

    def _sign(self, method: Literal["GET", "PUT"], key: str, seconds: float) -> str:
        if self._signer is None:
            raise ValueError("a folder has no addresses; look at Store.signs first")
        with translated(key, writing=True):
            return obstore.sign(self._signer, method, key, timedelta(seconds=seconds))

    @contextlib.contextmanager
    def _reading(self, key: str) -> Iterator[None]:
        try:
            with translated(key):
                yield
        except MissingBlobError:
            self._require_marker()
            raise

    @contextlib.asynccontextmanager
    async def _reading_async(self, key: str) -> AsyncIterator[None]:
        try:
            with translated(key):
                yield
        except MissingBlobError:
            await self._require_marker_aside()
            raise

    def _require_marker(self) -> None:
        if not self.is_prepared():
            log.warning("%s lacks its file %s: is its disk mounted?", self.folder, MARKER)
            raise StoreUnavailableError

    async def _require_marker_aside(self) -> None:
        if self.folder:  # a disk that hangs must not hang the event loop
            await asyncio.to_thread(self._require_marker)

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
        # The disk may have gone since the marker was seen before the write.
        self._require_marker()


def open_store(settings: Settings) -> Store:
    """The store of these settings."""
    return Store(settings.blobs, settings.s3)


def _whole(key: str, data: bytes, length: int) -> bytes:
    """The bytes, where they are as many as asked for: an object that was cut is a missing one."""
    if len(data) != length:
        raise MissingBlobError(key)
    return data
