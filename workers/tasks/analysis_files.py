"""Files that analyses make: stored, counted to the fleet's quota, and kept with the answer."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

from sqlalchemy.orm import Session

from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.base import Json
from service.platform.db.recordings import Recording
from service.platform.jobs.claims import Claim, require_mine
from service.platform.storage.blobs import keep, reserve
from service.platform.storage.quota import counted, recounting, require_quota, take
from workers.tasks.context import Context
from workers.tasks.originals import store_files

_PIECE = 1 << 20


def store_file(context: Context, claim: Claim, file: Path, prefix: str) -> str:
    """Put a file into the store, and return its key under ``prefix``.

    Raises :class:`ReadError` ``fleet_quota_exceeded``, ``ingest_disk_full``.
    """

    def reserved(sizes: Mapping[str, int]) -> dict[str, str]:
        return {name: _reserve(context, claim, prefix, file.suffix, size) for name, size in sizes.items()}

    return store_files(context, {"": file}, reserved)[""][0]


def keeping(claim: Claim, key: str, file: Path, name: str, facts: Json) -> Callable[[Session], Json]:
    """Return a function that keeps the analysis's file, called ``name``, and hands over the result with ``facts``."""
    size, sha256 = file.stat().st_size, _digest(file)

    def write(session: Session) -> Json:
        row = session.get_one(Analysis, claim.subject_id)
        with recounting(session, row.recording_id, besides=claim.job_id):
            keep(session, key, size=size, sha256=sha256)
            session.add(AnalysisFile(analysis_id=row.id, blob_key=key, file_name=name))
        return {"file_name": name, "size": size, "sha256": sha256, **facts}

    return write


def _digest(file: Path) -> str:
    whole = hashlib.sha256()
    with file.open("rb") as content:
        while piece := content.read(_PIECE):
            whole.update(piece)
    return whole.hexdigest()


def _reserve(context: Context, claim: Claim, prefix: str, suffix: str, size: int) -> str:
    """A key, if the fleet has room: what a recording's jobs reserve counts, so that several do not exceed it."""
    allowed = context.settings.fleet_quota_bytes
    with context.database.writing() as session:
        require_mine(session, claim)
        row = session.get_one(Analysis, claim.subject_id)
        if row.recording_id is None:
            require_quota(session, row.fleet_id, size, allowed)
        else:
            recording = session.get_one(Recording, row.recording_id, with_for_update=True)
            take(session, recording, counted(session, recording, besides=claim.job_id) + size, allowed)
        return reserve(session, prefix, suffix=suffix, size=size, job_id=claim.job_id, attempt=claim.attempt)
