"""A recording with its published calibration, as another file of the store: its own file, or one for viewers."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.recordings import Recording, UploadPart
from service.db.repeating import repeated
from service.db.studies import CalibratedCopy, Study
from service.jobs.claims import Claim, Lease, require_mine
from service.storage.blobs import keep, reserve
from service.storage.quota import QuotaExceededError, counted, take
from workers.readers.limited import write_limited
from workers.readers.recording import ReadError
from workers.tasks.context import Context
from workers.tasks.loading import require_room
from workers.tasks.originals import join_parts, reading_limits
from workers.tasks.viewing import viewer_file

_PIECE = 1 << 20
_EDITS = ("lidar_frame", "cameras", "poses")


def calibrated_copy(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Write the file in a limited child, and store it."""
    with context.database.reading() as session:
        study = session.get_one(Study, held.subject_id)
        recording = session.get_one(Recording, study.recording_id)
    asked = study.asked
    write_file, ending = (viewer_file, "for-viewers") if asked.get("for_viewers") else (_copy, "calibrated")
    with context.scratch() as folder:
        made = write_file(context, recording, asked, folder, lease)
        file = folder / "copy" / made["file"]
        size, digest = file.stat().st_size, _digest(file)
        key = _store(context, held, recording.id, file, size)
    name = f"{_stem(recording.file_name)}-{ending}{file.suffix}"
    counts = {one: made[one] for one in ("copied", "replaced", "added", "left_out") if one in made}

    def write(session: Session) -> None:
        row = session.get_one(Recording, recording.id, with_for_update=True)
        keep(session, key, size=size, sha256=digest)
        session.add(CalibratedCopy(study_id=held.subject_id, blob_key=key, file_name=name))
        session.flush()
        row.taken_bytes = counted(session, row, besides=held.job_id)
        session.get_one(Study, held.subject_id).result = {"file_name": name, "size": size, "sha256": digest, **counts}

    return write


def _copy(context: Context, recording: Recording, asked: Json, folder: Path, lease: Lease) -> dict[str, Any]:
    """The recording's own file with the calibration put in."""
    with context.database.reading() as session:
        parts = session.scalars(
            select(UploadPart).where(UploadPart.recording_id == recording.id).order_by(UploadPart.number)
        ).all()
    return write_limited(
        [join_parts(context, recording, parts, folder, lease)],
        folder / "copy",
        {"copy": {name: asked[name] for name in _EDITS}},
        limits=reading_limits(context.settings, recording.size),
        name=recording.file_name,
        must_stop=lease.check,
        on_progress=lambda progress: lease.report(0.1 + 0.8 * (progress.share or 0.0), "copying messages"),
    )


def _stem(file_name: str) -> str:
    """The recording's name without its ends (.tar.gz), at most 200 letters of it."""
    return (file_name.lstrip(".").partition(".")[0] or "recording")[:200]


def _digest(file: Path) -> str:
    whole = hashlib.sha256()
    with file.open("rb") as content:
        while piece := content.read(_PIECE):
            whole.update(piece)
    return whole.hexdigest()


def _store(context: Context, held: Claim, recording_id: UUID, file: Path, size: int) -> str:
    """Put the copy into the store, and return its key.

    Raises :class:`ReadError` ``fleet_quota_exceeded``, ``ingest_disk_full``.
    """
    require_room(context, context.store.free_bytes(), size)
    try:
        key = repeated(lambda: _reserve(context, held, recording_id, file.suffix, size))
    except QuotaExceededError as error:
        raise ReadError(error.code, error.message, error.hint, error.fields) from None
    context.store.put_file(key, file)
    return key


def _reserve(context: Context, held: Claim, recording_id: UUID, suffix: str, size: int) -> str:
    """A key, if the fleet has room: what is reserved counts, so that several jobs do not exceed it together."""
    with context.database.writing() as session:
        require_mine(session, held)
        recording = session.get_one(Recording, recording_id, with_for_update=True)
        taken = counted(session, recording, besides=held.job_id) + size
        take(session, recording, taken, context.settings.fleet_quota_bytes)
        prefix = f"recordings/{recording_id}/copies"
        return reserve(session, prefix, suffix=suffix, size=size, job_id=held.job_id, attempt=held.attempt)
