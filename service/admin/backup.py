"""A backup: the rows of one moment, and every object that they name.

Removals from the store are held first, then the database's snapshot is taken, then the objects are copied. So every
object that the snapshot names exists until the hold ends. The service goes on working.

An object that the store lost or changed, or cannot read, does not keep the others from being backed up: the manifest
names it.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

from sqlalchemy import case, or_, select

from apexcal.documents.states import RecordingState
from service.admin.context import AdminError
from service.admin.manifest import BLOB_LIST, BLOBS, FORMAT, ROWS, BlobFile, Damaged, Manifest, digest, write_rows
from service.admin.objects import holding, retried
from service.platform.db.clock import now, utc_now
from service.platform.db.jobs import Heartbeat
from service.platform.db.recordings import Blob, Recording, UploadPart
from service.platform.db.revisions import newest
from service.platform.db.session import Database, put
from service.platform.storage.errors import MissingBlobError, StoreUnavailableError
from service.platform.storage.store import Store

_COPIES_AT_ONCE = 4
# Unreadable objects in a row that mean that the store is away, and not bad sectors: the backup is given up.
_AWAY = 8

Report = Callable[[str], None]


class _Named(NamedTuple):
    """An object as its row says it is; the checksum where that is known."""

    key: str
    size: int
    sha256: str | None


class _Copied(NamedTuple):
    """The state of one copied object, and what is wrong with it."""

    file: BlobFile | None
    damage: str = ""


def back_up(database: Database, store: Store, target: Path, *, report: Report = lambda _: None) -> Manifest:
    """Write a backup into the new folder ``target``.

    Raises :class:`AdminError` where the folder exists, :class:`StoreUnavailableError` where no object can be read.
    """
    if target.exists():
        raise AdminError(f"{target} exists already", "Name a folder that does not exist; each backup has its own.")
    target.parent.mkdir(parents=True, exist_ok=True)
    staged = Path(mkdtemp(prefix=f"{target.name}.partial-", dir=target.parent))
    try:
        manifest = _write(database, store, target, staged, report)
        staged.rename(target)
    except BaseException:
        shutil.rmtree(staged, ignore_errors=True)
        raise
    with database.writing() as session:
        put(session, Heartbeat, {"name": "backup"}, {"at": now()})
    return manifest


def _write(database: Database, store: Store, target: Path, staged: Path, report: Report) -> Manifest:
    with holding(database, f"backup to {target}"[:100]) as check:
        rows, named = _rows(database, staged / ROWS)
        for name, count in rows.items():
            report(f"{name}: {count} rows")
        blobs, damaged = _copy(store, named, staged, report)
        check()
    (staged / BLOB_LIST).write_text("".join(blob.model_dump_json() + "\n" for blob in blobs))
    manifest = Manifest(
        format=FORMAT,
        made_at=utc_now().isoformat(),
        version=version("apexcal"),
        schema_revision=newest(),
        rows=rows,
        files={name: digest(staged / name) for name in (ROWS, BLOB_LIST)},
        blobs=len(blobs),
        blob_bytes=sum(blob.size for blob in blobs),
        damaged=damaged,
    )
    manifest.write(staged)
    _make_durable(staged)
    return manifest


def _rows(database: Database, file: Path) -> tuple[dict[str, int], list[_Named]]:
    with database.snapshot() as session:
        connection = session.connection()
        # The checksum of a part that went straight to the store is its sender's word until its recording was read.
        is_checked = or_(UploadPart.number.is_(None), Recording.state == RecordingState.READY)
        statement = (
            select(Blob.key, Blob.size, case((is_checked, Blob.sha256)))
            .outerjoin(UploadPart, UploadPart.blob_key == Blob.key)
            .outerjoin(Recording, Recording.id == UploadPart.recording_id)
            .where(Blob.state == "stored")
            .order_by(Blob.key)
        )
        # The first statement fixes the moment.
        named = [_Named(key, size, sha256) for key, size, sha256 in connection.execute(statement)]
        return write_rows(connection, file), named


def _copy(store: Store, named: list[_Named], staged: Path, report: Report) -> tuple[list[BlobFile], list[Damaged]]:
    (staged / BLOBS).mkdir()
    copies = _Copies(store, staged)
    with ThreadPoolExecutor(_COPIES_AT_ONCE) as pool:
        copied = list(pool.map(copies.make, named))
    if named and copies.unreadable == len(named):
        raise StoreUnavailableError
    files = [copy.file for copy in copied if copy.file]
    pairs = zip(named, copied, strict=True)
    damaged = [Damaged(key=blob.key, what=copy.damage) for blob, copy in pairs if copy.damage]
    report(f"{len(files)} objects, {sum(file.size for file in files)} bytes")
    return files, damaged


class _Copies:
    """Copies of objects in the backup's folder; several threads make them."""

    def __init__(self, store: Store, staged: Path) -> None:
        self._store = store
        self._staged = staged
        self._guard = threading.Lock()
        self._in_a_row = 0
        self.unreadable = 0

    def make(self, named: _Named) -> _Copied:
        """Copy what is there, damaged or not: a restore then brings back as much as there was.

        Raises :class:`StoreUnavailableError` where nothing has been readable for a while.
        """
        path = BlobFile(key=named.key, size=named.size, sha256="").path(self._staged)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            sha256 = retried(lambda: _fetch(self._store, named.key, path))
        except MissingBlobError:
            path.unlink(missing_ok=True)
            return self._counted(_Copied(None, "missing"))
        except StoreUnavailableError:
            path.unlink(missing_ok=True)
            return self._counted(_Copied(None, "not readable: the store fails on it"), readable=False)
        return self._counted(_compared(named, BlobFile(key=named.key, size=path.stat().st_size, sha256=sha256)))

    def _counted(self, copied: _Copied, *, readable: bool = True) -> _Copied:
        with self._guard:
            self._in_a_row = 0 if readable else self._in_a_row + 1
            self.unreadable += not readable
            if self._in_a_row >= _AWAY:
                raise StoreUnavailableError
        return copied


def _fetch(store: Store, key: str, path: Path) -> str:
    """Write an object's bytes into a file, and return their SHA-256."""
    sha256 = hashlib.sha256()
    with path.open("wb") as file:
        for chunk in store.stream(key):
            file.write(chunk)
            sha256.update(chunk)
        file.flush()
        os.fsync(file.fileno())
    return sha256.hexdigest()


def _compared(named: _Named, copied: BlobFile) -> _Copied:
    if copied.size != named.size:
        return _Copied(copied, f"{copied.size} bytes instead of {named.size}")
    if named.sha256 and copied.sha256 != named.sha256:
        return _Copied(copied, "not the bytes that were stored: the SHA-256 differs")
    return _Copied(copied)


def _make_durable(folder: Path) -> None:
    for path in (*(inner for inner in folder.rglob("*") if inner.is_dir()), *folder.iterdir(), folder):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
