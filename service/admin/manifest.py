"""What a backup holds: its manifest, its files, and how it is checked before anything is restored from it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from service.admin.errors import AdminError
from service.admin.rows import TableFile, digest, lines_of

FORMAT = 1
MANIFEST, BLOBS, BLOB_LIST, TABLES = "manifest.json", "blobs", "blobs.jsonl", "tables"


@dataclass(frozen=True)
class Damaged:
    """An object that is not what its row says: the store had lost, changed or could not read it for the backup."""

    key: str
    what: str


@dataclass(frozen=True)
class Manifest:
    """``schema`` is the revision of the rows; ``blob_list`` the SHA-256 of the list of objects.

    ``damaged`` are those that are missing or were unreadable, or are in the backup as they were found.
    """

    format: int
    made_at: str
    version: str
    schema: str
    tables: list[TableFile]
    blobs: int
    blob_bytes: int
    blob_list: str
    damaged: list[Damaged] = field(default_factory=list[Damaged])

    def write(self, folder: Path) -> None:
        """Write the manifest, the last file of a backup: a backup without it does not count."""
        document = {**asdict(self), "tables": [table._asdict() for table in self.tables]}
        (folder / MANIFEST).write_text(json.dumps(document, indent=1) + "\n")


@dataclass(frozen=True)
class BlobFile:
    """A copied object."""

    key: str
    size: int
    sha256: str

    def path(self, folder: Path) -> Path:
        """Where it lies in a backup. Raises :class:`AdminError` for a key that leads out of it."""
        path = (folder / BLOBS / self.key).resolve()
        if not path.is_relative_to((folder / BLOBS).resolve()):
            raise AdminError(f"the backup names an object outside itself: {self.key!r}", "Do not restore it.")
        return path


def table_path(folder: Path, name: str) -> Path:
    """Where a table's rows lie."""
    return folder / TABLES / f"{name}.jsonl.gz"


def read_manifest(folder: Path) -> Manifest:
    """A backup's manifest. Raises :class:`AdminError` where there is none, or one of another format."""
    try:
        document: dict[str, Any] = json.loads((folder / MANIFEST).read_text())
        tables = [
            TableFile(one["name"], [(name, kind) for name, kind in one["columns"]], one["rows"], one["sha256"])
            for one in document["tables"]
        ]
        damaged = [Damaged(**one) for one in document.get("damaged", [])]
        found = Manifest(**{**document, "tables": tables, "damaged": damaged})
    except FileNotFoundError:
        raise AdminError(
            f"{folder} is no finished backup: it has no {MANIFEST}", "Name the folder that `backup` printed."
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise AdminError(f"{folder / MANIFEST} cannot be read: {error}", "Use another backup.") from None
    if found.format != FORMAT:
        raise AdminError(
            f"this is a backup of format {found.format}; this version reads format {FORMAT}",
            "Restore it with the version that made it, or a newer one.",
        )
    return found


def verify(folder: Path) -> tuple[Manifest, list[BlobFile]]:
    """Check every file of a backup against its SHA-256. Raises :class:`AdminError` naming the first that differs."""
    manifest = read_manifest(folder)
    for table in manifest.tables:
        _check(table_path(folder, table.name), table.sha256)
    _check(folder / BLOB_LIST, manifest.blob_list)
    blobs = [BlobFile(**line) for line in lines_of(folder / BLOB_LIST)]
    for blob in blobs:
        _check(blob.path(folder), blob.sha256)
    return manifest, blobs


def _check(path: Path, sha256: str) -> None:
    try:
        found = digest(path)
    except OSError as error:
        raise AdminError(
            f"{path} of the backup cannot be read: {error.strerror}", "Nothing was restored. Use another backup."
        ) from None
    if found != sha256:
        raise AdminError(
            f"{path} is not what was backed up: its SHA-256 differs", "Nothing was restored. Use another backup."
        )
