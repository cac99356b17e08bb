"""Removes recordings at the end of their retention, and unfinished uploads."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial
from uuid import UUID

from sqlalchemy import ColumnElement, Select, delete, exists, func, literal, or_, select
from sqlalchemy.orm import Session, aliased

from apexcal.documents.states import UNENDED, RecordingState
from service.platform.broker.hints import hint
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json, state_literal
from service.platform.db.calibrations import CalibrationRun, CorrespondenceSet, Publication, Result
from service.platform.db.clock import now
from service.platform.db.detections import Detection
from service.platform.db.fleets import Fleet
from service.platform.db.jobs import Job
from service.platform.db.recordings import LAYERS, Recording, UploadPart
from service.platform.db.rounds import one_by_one
from service.platform.db.session import Database
from service.platform.http.problems import Problem
from service.platform.storage.blobs import condemn
from service.recordings.actions import delete_recording, delete_set, remove_layers
from service.recordings.upload_actions import EXPIRED

log = logging.getLogger(__name__)

_OVERDUE = (Recording.retain_until < now()) & or_(Recording.kept_until.is_(None), Recording.kept_until < now())
_LATE = (Recording.state == RecordingState.UPLOADING) & (Recording.expires_at < now())
_DAY_S = 86400.0
_TOLD_S = 7 * _DAY_S

_WAITS = "Its retention has ended; it is kept because a vehicle's current calibration came from it."


def delete_overdue(database: Database) -> int:
    """Delete the recordings whose retention has ended, each in its own transaction, and return how many.

    One that a vehicle's current calibration came from stays until another is published, and says so. It is looked at
    again after a day.
    """
    # Without a limit: those that stay would fill it at every round, and the others would never be reached.
    with database.reading() as session:
        overdue = session.scalars(select(Recording.id).where(_OVERDUE).order_by(Recording.retain_until)).all()
    return sum(one_by_one("recording", overdue, partial(_delete, database)))


def remove_old_layers(database: Database) -> int:
    """Remove the layers whose time has ended in their fleet, each recording in its own transaction; how many.

    What is being read, packed, detected or copied at the moment waits for the next round.
    """
    with database.reading() as session:
        overdue = [id for fleet_id in _fleets(session) for id in dict(_old_layers(session, fleet_id))]
    return sum(one_by_one("recording", overdue, partial(_remove_layers, database)))


def _remove_layers(database: Database, recording_id: UUID) -> bool:
    with database.writing() as session:
        row = session.get(Recording, recording_id, with_for_update=True)
        counts = row and _old_layers(session, row.fleet_id, Recording.id == recording_id)
        if not row or not counts:
            return False
        remove_layers(session, row, max(counts)[1])
        hint(session, row.fleet_id, "recording", row.id)
    return True


def _fleets(session: Session) -> Sequence[UUID]:
    """Return the fleets with something to remove."""
    return session.scalars(select(Fleet.id).where(Fleet.retention.is_not(None))).all()


def _days(session: Session, fleet_id: UUID) -> Json:
    """Return the days after which each layer goes."""
    return session.scalar(select(Fleet.retention).where(Fleet.id == fleet_id)) or {}


def _old_layers(session: Session, fleet_id: UUID, *which: ColumnElement[bool]) -> list[tuple[UUID, int]]:
    """Recordings, each with the number of a layer whose time has ended."""
    days = _days(session, fleet_id)
    layers = [(count, days[layer]) for count, layer in enumerate(LAYERS, 1) if layer in days]
    return [
        (id, count)
        for count, age in layers
        for id in session.scalars(_with_layer(fleet_id, count, age).where(*which)).all()
    ]


def _with_layer(fleet_id: UUID, count: int, days: float) -> Select[UUID]:
    """Return recordings that have had this layer for at least these days, and whose jobs have ended."""
    of_detection = select(Detection.id).where(Detection.recording_id == Recording.id)
    of_analysis = select(Analysis.id).where(Analysis.recording_id == Recording.id)
    working = [
        exists().where(Job.subject_id.in_(subjects), Job.state.in_([state_literal(state) for state in UNENDED]))
        for subjects in (of_detection, of_analysis)
    ]
    return select(Recording.id).where(
        Recording.fleet_id == fleet_id,
        Recording.layers_gone < count,
        Recording.created_at < now(-_DAY_S * days),
        Recording.state == RecordingState.READY,
        *(~work for work in working),
    )


def delete_old_imports(database: Database) -> int:
    """Delete imported pairs whose time has ended in their fleet, with their calibrations; how many.

    Pairs stay if one of their calibrations was ever published, or if they were imported or calibrated again since.
    """
    with database.reading() as session:
        old = [id for fleet_id in _fleets(session) for id in session.scalars(_old_imports(session, fleet_id)).all()]
    return sum(one_by_one("set of pairs", old, partial(_delete_import, database)))


def _delete_import(database: Database, set_id: UUID) -> bool:
    own = CorrespondenceSet.id == set_id
    with database.writing() as session:
        row = session.get(CorrespondenceSet, set_id)
        return row is not None and delete_set(
            session, row, lambda: session.scalar(_old_imports(session, row.fleet_id).where(own)) is not None
        )


def _old_imports(session: Session, fleet_id: UUID) -> Select[UUID]:
    days = _days(session, fleet_id).get("pairs")
    before = now(-_DAY_S * (days or 0.0))
    used = aliased(CorrespondenceSet)
    # A selection goes with the set that it is of.
    runs = (
        select(CalibrationRun.calibration_id)
        .join(used, used.id == CalibrationRun.set_id)
        .where(or_(used.id == CorrespondenceSet.id, used.whole_id == CorrespondenceSet.id))
        .correlate(CorrespondenceSet)
    )
    published = select(Publication.id).join(Result, Publication.result_id == Result.id)
    return select(CorrespondenceSet.id).where(
        literal(days is not None),
        CorrespondenceSet.fleet_id == fleet_id,
        CorrespondenceSet.source == "import",
        func.coalesce(CorrespondenceSet.brought_at, CorrespondenceSet.created_at) < before,
        ~runs.where(CalibrationRun.created_at > before).exists(),
        # A calibration goes with the set, so what it published for a camera with other pairs counts, too.
        ~published.where(Result.calibration_id.in_(runs)).exists(),
    )


def expire_uploads(database: Database) -> int:
    """End the uploads that nobody went on with, each in its own transaction, and return how many.

    Their parts go; the recording stays for a week, so that a client that comes back hears what became of it.
    """
    with database.reading() as session:
        late = session.scalars(select(Recording.id).where(_LATE).order_by(Recording.expires_at)).all()
    return sum(one_by_one("upload", late, partial(_expire, database)))


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
            fleet_id = session.scalar(select(Recording.fleet_id).where(Recording.id == recording_id))
            if fleet_id is None:
                return False
            hint(session, fleet_id, "recording", recording_id)
            delete_recording(session, recording_id, with_published=False, which=_OVERDUE)
    except Problem:
        with database.writing() as session:
            mine = select(Recording).where(Recording.id == recording_id, _OVERDUE)
            row = session.scalars(mine.with_for_update()).first()
            if row is not None:
                row.kept_until = session.scalars(select(now(_DAY_S))).one()
            if row is not None and _WAITS not in row.warnings:
                row.warnings = [*row.warnings, _WAITS]
                row.version += 1
        return False
    log.info("deleted recording %s: its retention has ended", recording_id)
    return True
