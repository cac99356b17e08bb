"""What a backup holds: its manifest, its files, and how it is checked before anything is restored from it."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from service.admin.errors import AdminError

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
        """Where it lies in a backup. Raises :class:`AdminError` for a key that leads out of it."""
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
        found = Manifest.model_validate_json((folder / MANIFEST).read_bytes())
    except FileNotFoundError:
        raise AdminError(
            f"{folder} is no finished backup: it has no {MANIFEST}", "Name the folder that `backup` printed."
        ) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "all of it"
        raise AdminError(
            f"{folder / MANIFEST} cannot be read: {where}: {first['msg']}", "Use another backup."
        ) from None
    if found.format != FORMAT:
        raise AdminError(
            f"this is a backup of format {found.format}; this version reads format {FORMAT}",
            "Restore it with the version that made it, or a newer one.",
        )
    return found


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
        found = digest(path)
    except OSError as error:
        raise AdminError(
            f"{path} of the backup cannot be read: {error.strerror}", "Nothing was restored. Use another backup."
        ) from None
    if found != sha256:
        raise AdminError(
            f"{path} is not what was backed up: its SHA-256 differs", "Nothing was restored. Use another backup."
        )
