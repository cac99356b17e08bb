"""The manifest and the files of a backup, and their check before anything is restored."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError
from sqlalchemy import Connection, func, insert, select, text

from apexcal.documents.base import first_fault
from service.admin.context import AdminError
from service.platform.db.migrate import upgrade
from service.platform.db.models import Base
from service.platform.db.session import Database

FORMAT = 1
MANIFEST, BLOBS, BLOB_LIST, ROWS = "manifest.json", "blobs", "blobs.jsonl", "rows.sqlite"


class _Written(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Damaged(_Written):
    """An object that is not what its row says: the store had lost, changed or could not read it for the backup."""

    key: str
    what: str


class BlobFile(_Written):
    """A copied object."""

    key: str
    size: int
    sha256: str

    def path(self, folder: Path) -> Path:
        """Return its place in a backup. Raises :class:`AdminError` for a key that leads out of it."""
        path = (folder / BLOBS / self.key).resolve()
        if not path.is_relative_to((folder / BLOBS).resolve()):
            raise AdminError(f"the backup names an object outside itself: {self.key!r}", "Do not restore it.")
        return path


class Manifest(_Written):
    """``schema_revision`` is that of the rows, ``rows`` their number by table; ``files`` the SHA-256 of the others.

    ``damaged`` are those that are missing or were unreadable, or are in the backup as they were found.
    """

    format: int
    made_at: str
    version: str
    schema_revision: str
    rows: dict[str, int]
    files: dict[str, str]
    blobs: int
    blob_bytes: int
    damaged: list[Damaged]

    def write(self, folder: Path) -> None:
        """Write the manifest, the last file of a backup: a backup without it does not count."""
        (folder / MANIFEST).write_text(self.model_dump_json(indent=1) + "\n")


def read_manifest(folder: Path) -> Manifest:
    """A backup's manifest. Raises :class:`AdminError` where there is none, or one of another format."""
    try:
        manifest = Manifest.model_validate_json((folder / MANIFEST).read_bytes())
    except FileNotFoundError:
        raise AdminError(
            f"{folder} is no finished backup: it has no {MANIFEST}", "Name the folder that `backup` printed."
        ) from None
    except ValidationError as error:
        where, wrong = first_fault(error)
        raise AdminError(
            f"{folder / MANIFEST} cannot be read: {where or 'all of it'}: {wrong}", "Use another backup."
        ) from None
    if manifest.format != FORMAT:
        raise AdminError(
            f"this is a backup of format {manifest.format}; this version reads format {FORMAT}",
            "Restore it with the version that made it, or a newer one.",
        )
    return manifest


def verify(folder: Path) -> tuple[Manifest, list[BlobFile]]:
    """Check every file of a backup against its SHA-256. Raises :class:`AdminError` naming the first that differs."""
    manifest = read_manifest(folder)
    for name in (ROWS, BLOB_LIST):
        _check(folder / name, manifest.files.get(name, "none"))
    blobs = [BlobFile.model_validate_json(line) for line in (folder / BLOB_LIST).read_text().splitlines()]
    for blob in blobs:
        _check(blob.path(folder), blob.sha256)
    return manifest, blobs


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check(path: Path, sha256: str) -> None:
    try:
        actual = digest(path)
    except OSError as error:
        raise AdminError(
            f"{path} of the backup cannot be read: {error.strerror}", "Nothing was restored. Use another backup."
        ) from None
    if actual != sha256:
        raise AdminError(
            f"{path} is not what was backed up: its SHA-256 differs", "Nothing was restored. Use another backup."
        )


# What only says how the service is at this moment.
TRANSIENT = frozenset(("heartbeat", "worker", "blob_hold"))
KEPT = tuple(table for table in Base.metadata.sorted_tables if table.name not in TRANSIENT)
_BATCH = 1000


def url_of(file: Path) -> str:
    """The database that a file of rows is."""
    return f"sqlite:///{file}"


def write_rows(source: Connection, file: Path) -> dict[str, int]:
    """Write every row that the connection's snapshot sees into a new file; how many there are by table."""
    upgrade(url_of(file))
    rows = Database(url_of(file))
    try:
        with rows.engine.begin() as target:
            counts = copy_rows(source, target)
        with rows.alone() as connection:
            # All of it in the one file: the write-ahead log goes.
            connection.exec_driver_sql("PRAGMA journal_mode=DELETE")
    finally:
        rows.close()
    return counts


def copy_rows(source: Connection, target: Connection) -> dict[str, int]:
    """Insert all rows of one database into another of the same schema, never holding many of them.

    A row comes after those that it refers to: tables are in that order, and in a table ids grow with time.
    """
    counts: dict[str, int] = {}
    for table in KEPT:
        counts[table.name] = 0
        statement = select(table).order_by(*table.primary_key)
        for rows in source.execution_options(yield_per=_BATCH).execute(statement).mappings().partitions():
            target.execute(insert(table), [dict(row) for row in rows])
            counts[table.name] += len(rows)
        numbered = table.autoincrement_column
        if numbered is not None and counts[table.name] and target.dialect.name == "postgresql":
            # SQLite numbers on after the highest by itself.
            target.execute(
                text("SELECT setval(pg_get_serial_sequence(:table, :column), :highest)"),
                {"table": table.name, "column": numbered.name, "highest": target.scalar(select(func.max(numbered)))},
            )
    return counts
