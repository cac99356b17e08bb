"""Removes recordings at the end of their retention, and unfinished uploads."""

from __future__ import annotations

import logging
from uuid import UUID

from sqlalchemy import delete, select
from sqlalchemy.exc import OperationalError

from apexcal.documents.states import RecordingState
from service.platform.broker.hints import hint
from service.platform.db.clock import now
from service.platform.db.recordings import Recording, UploadPart
from service.platform.db.session import Database
from service.platform.http.problems import Problem
from service.platform.storage.blobs import condemn
from service.recordings.actions import delete_recording
from service.recordings.upload_actions import EXPIRED

log = logging.getLogger(__name__)

_LATE = (Recording.state == RecordingState.UPLOADING) & (Recording.expires_at < now())
_TOLD_S = 7 * 86400.0

_WAITS = "Its retention has ended; it is kept because a vehicle's current calibration came from it."


def delete_overdue(database: Database) -> int:
    """Delete the recordings whose retention has ended, each in its own transaction, and return how many.

    One that a vehicle's current calibration came from stays until another is published, and says so.
    """
    # All of them: of a part, those that stay would be looked at again and again, and the others never.
    with database.reading() as session:
        ended = select(Recording.id).where(Recording.retain_until < now()).order_by(Recording.retain_until)
        overdue = session.scalars(ended).all()
    deleted = 0
    for recording_id in overdue:
        try:
            deleted += _delete(database, recording_id)
        except OperationalError as error:
            # A deadlock, or a database that is busy: the others need not wait for the next round too.
            log.warning(
                "recording %s, whose retention has ended, is left for the next time: %s", recording_id, error.orig
            )
    return deleted


def expire_uploads(database: Database) -> int:
    """End the uploads that nobody went on with, each in its own transaction, and return how many.

    Their parts go; the recording stays for a week, so that a client that comes back hears what became of it.
    """
    with database.reading() as session:
        late = session.scalars(select(Recording.id).where(_LATE).order_by(Recording.expires_at)).all()
    return sum(_expire(database, recording_id) for recording_id in late)


def _expire(database: Database, recording_id: UUID) -> bool:
    with database.writing() as session:
        row = session.scalars(select(Recording).where(Recording.id == recording_id, _LATE).with_for_update()).first()
        if row is None:
            return False
        parts = select(UploadPart.blob_key).where(UploadPart.recording_id == recording_id)
        condemn(session, session.scalars(parts).all())
        session.execute(delete(UploadPart).where(UploadPart.recording_id == recording_id))
        row.state, row.taken_bytes = RecordingState.FAILED, 0
        row.problem = {
            "code": EXPIRED,
            "detail": "No further part of this upload came in time, so the parts that had come were removed.",
            "hint": "Upload the file again as a new recording, and delete this one.",
        }
        told_until = session.scalars(select(now(_TOLD_S))).one()
        row.retain_until = min(row.retain_until or told_until, told_until)
        row.version += 1
        hint(session, row.fleet_id, "recording", row.id)
    log.info("the upload of recording %s was left unfinished; its parts are removed", recording_id)
    return True


def _delete(database: Database, recording_id: UUID) -> bool:
    try:
        with database.writing() as session:
            row = session.get(Recording, recording_id)
            if row is None:
                return False
            hint(session, row.fleet_id, "recording", recording_id)
            session.expunge(row)
            delete_recording(session, recording_id, with_published=False)
    except Problem:
        with database.writing() as session:
            row = session.get(Recording, recording_id, with_for_update=True)
            if row is not None and _WAITS not in row.warnings:
                row.warnings = [*row.warnings, _WAITS]
                row.version += 1
        return False
    log.info("deleted recording %s: its retention has ended", recording_id)
    return True
