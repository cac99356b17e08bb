"""A backup: the rows of one moment, and every object that they name.

The store is held first, then the database's snapshot is taken, then the objects are copied: what a row of the
snapshot names was there when the hold began to bind, and is removed only after it ends. The service goes on working.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import mkdtemp

from sqlalchemy import Connection, select

from service.admin.errors import AdminError
from service.admin.holding import holding
from service.admin.manifest import BLOB_LIST, BLOBS, FORMAT, TABLES, BlobFile, Manifest, table_path
from service.admin.rows import TableFile, digest, write_table
from service.db.clock import now, utc_now
from service.db.jobs import Heartbeat
from service.db.migrate import newest
from service.db.models import Base
from service.db.recordings import Blob
from service.db.session import Database
from service.storage.errors import MissingBlobError
from service.storage.store import Store

# What only says how the service is at this moment.
TRANSIENT = frozenset(("heartbeat", "worker", "blob_hold"))
_COPIES_AT_ONCE = 4

Report = Callable[[str], None]


def back_up(database: Database, store: Store, target: Path, *, report: Report = lambda _: None) -> Manifest:
    """Write a backup into the new folder ``target``.

    Raises :class:`AdminError` where the folder exists, or where an object that a row names is missing.
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
        session.merge(Heartbeat(name="backup", at=now()))
    return manifest


def _write(database: Database, store: Store, target: Path, staged: Path, report: Report) -> Manifest:
    (staged / TABLES).mkdir()
    with holding(database, f"backup to {target}"[:100]) as check:
        tables, named = _rows(database, staged, report)
        blobs = _copy(store, named, staged, report)
        check()
    (staged / BLOB_LIST).write_text("".join(json.dumps(asdict(blob)) + "\n" for blob in blobs))
    manifest = Manifest(
        format=FORMAT,
        made_at=utc_now().isoformat(),
        version=version("apexcal"),
        schema=newest(),
        tables=tables,
        blobs=len(blobs),
        blob_bytes=sum(blob.size for blob in blobs),
        blob_list=digest(staged / BLOB_LIST),
    )
    manifest.write(staged)
    _make_durable(staged)
    return manifest


@contextmanager
def _snapshot(database: Database) -> Iterator[Connection]:
    """A connection that sees the database of one moment, whatever is written meanwhile, and holds nobody up."""
    options = {} if database.engine.dialect.name == "sqlite" else {"isolation_level": "REPEATABLE READ"}
    with database.engine.connect().execution_options(**options) as connection, connection.begin():
        yield connection


def _rows(database: Database, staged: Path, report: Report) -> tuple[list[TableFile], list[tuple[str, int]]]:
    with _snapshot(database) as connection:
        # The first statement fixes the moment.
        asked = select(Blob.key, Blob.size).where(Blob.state == "stored").order_by(Blob.key)
        named = [(key, size) for key, size in connection.execute(asked)]
        written: list[TableFile] = []
        for table in Base.metadata.sorted_tables:
            if table.name not in TRANSIENT:
                written.append(write_table(connection, table, table_path(staged, table.name)))
                report(f"{table.name}: {written[-1].rows} rows")
    return written, named


def _copy(store: Store, named: list[tuple[str, int]], staged: Path, report: Report) -> list[BlobFile]:
    (staged / BLOBS).mkdir()
    with ThreadPoolExecutor(_COPIES_AT_ONCE) as pool:
        copied = list(pool.map(partial(_copy_one, store, staged), named))
    missing = [key for (key, _), blob in zip(named, copied, strict=True) if blob is None]
    if missing:
        raise AdminError(
            f"{len(missing)} objects that rows name are missing or cut, the first of them {missing[0]}",
            "No backup was made. The store has lost them: bring the objects back, or delete the recordings that they "
            "belong to.",
        )
    found = [blob for blob in copied if blob]
    report(f"{len(found)} objects, {sum(blob.size for blob in found)} bytes")
    return found


def _copy_one(store: Store, staged: Path, named: tuple[str, int]) -> BlobFile | None:
    key, size = named
    path = BlobFile(key, size, "").path(staged)
    path.parent.mkdir(parents=True, exist_ok=True)
    found = hashlib.sha256()
    try:
        with path.open("wb") as file:
            for chunk in store.stream(key):
                file.write(chunk)
                found.update(chunk)
            file.flush()
            os.fsync(file.fileno())
    except MissingBlobError:
        return None
    return BlobFile(key, size, found.hexdigest()) if path.stat().st_size == size else None


def _make_durable(folder: Path) -> None:
    for path in (*(one for one in folder.rglob("*") if one.is_dir()), *(folder / TABLES).iterdir(), folder):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
