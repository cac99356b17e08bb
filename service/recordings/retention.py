"""Recordings show people, so whoever uploads one may say when it goes: after that it is deleted by itself."""

from __future__ import annotations

import logging
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.exc import OperationalError

from service.db.clock import now
from service.db.recordings import Recording
from service.db.session import Database
from service.events.hints import hint
from service.http.problems import Problem
from service.recordings.deletion import delete_recording

log = logging.getLogger(__name__)

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
