"""Files that analyses make: stored below their recording, and counted to the fleet's quota."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from uuid import UUID

from sqlalchemy.orm import Session

from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.base import Json
from service.platform.db.recordings import Recording
from service.platform.db.repeating import repeated
from service.platform.jobs.claims import Claim, require_mine
from service.platform.storage.blobs import keep, reserve
from service.platform.storage.quota import QuotaExceededError, counted, take
from workers.readers.recording import ReadError
from workers.tasks.context import Context
from workers.tasks.loading import require_room

_PIECE = 1 << 20


class StoredFile(NamedTuple):
    """A file in the store that nothing keeps yet."""

    key: str
    size: int
    sha256: str


def store_file(context: Context, held: Claim, recording_id: UUID, file: Path, folder: str) -> StoredFile:
    """Put a file into the store, below the recording's ``folder``.

    Raises :class:`ReadError` ``fleet_quota_exceeded``, ``ingest_disk_full``.
    """
    size, digest = file.stat().st_size, _digest(file)
    require_room(context, context.store.free_bytes(), size)
    prefix = f"recordings/{recording_id}/{folder}"
    try:
        key = repeated(lambda: _reserve(context, held, recording_id, prefix, file.suffix, size))
    except QuotaExceededError as error:
        raise ReadError(error.code, error.message, error.hint, error.fields) from None
    context.store.put_file(key, file)
    return StoredFile(key, size, digest)


def keeping(held: Claim, recording_id: UUID, file: StoredFile, name: str, told: Json) -> Callable[[Session], None]:
    """What ends the analysis with its file, called ``name``; ``told`` stands beside it in the result."""

    def write(session: Session) -> None:
        row = session.get_one(Recording, recording_id, with_for_update=True)
        keep(session, file.key, size=file.size, sha256=file.sha256)
        session.add(AnalysisFile(analysis_id=held.subject_id, blob_key=file.key, file_name=name))
        session.flush()
        row.taken_bytes = counted(session, row, besides=held.job_id)
        session.get_one(Analysis, held.subject_id).result = {
            "file_name": name,
            "size": file.size,
            "sha256": file.sha256,
            **told,
        }

    return write


def _digest(file: Path) -> str:
    whole = hashlib.sha256()
    with file.open("rb") as content:
        while piece := content.read(_PIECE):
            whole.update(piece)
    return whole.hexdigest()


def _reserve(context: Context, held: Claim, recording_id: UUID, prefix: str, suffix: str, size: int) -> str:
    """A key, if the fleet has room: what is reserved counts, so that several jobs do not exceed it together."""
    with context.database.writing() as session:
        require_mine(session, held)
        recording = session.get_one(Recording, recording_id, with_for_update=True)
        taken = counted(session, recording, besides=held.job_id) + size
        take(session, recording, taken, context.settings.fleet_quota_bytes)
        return reserve(session, prefix, suffix=suffix, size=size, job_id=held.job_id, attempt=held.attempt)
