"""Jobs that ingest an upload. Here, where one begins, and where an upload expires, a recording's state changes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from uuid import UUID

from sqlalchemy.orm import Session

from apexcal.documents.states import RecordingState, WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.jobs import Job
from service.platform.db.recordings import Recording
from service.platform.jobs.kinds import Kind, existing, failed_subject
from service.platform.jobs.queue import enqueue
from service.platform.storage.quota import copied

_CANCELLED: Json = {
    "code": "cancelled",
    "detail": "The work was cancelled.",
    "hint": "Ask for it again when you want it.",
}


def queue_ingestion(session: Session, row: Recording) -> Job:
    """Queue a recording's ingestion, in the transaction that says so."""
    job = enqueue(session, kind="ingest", fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = RecordingState.QUEUED, None, job.id
    row.version += 1
    hint(session, row.fleet_id, "recording", row.id)
    return job


def _end(session: Session, ids: Collection[UUID], state: WorkState, problem: Json | None) -> None:
    done = state == WorkState.DONE
    for row in existing(session, Recording, ids):
        row.state = RecordingState.READY if done else RecordingState.FAILED
        row.problem = problem or (_CANCELLED if state == WorkState.CANCELLED else None)
        if not done:
            row.taken_bytes = row.size + copied(session, row.id)
        row.version += 1
        hint(session, row.fleet_id, "recording", row.id)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    row = failed_subject(session, job, Recording, "recording")
    return [queue_ingestion(session, row)]


def kinds(take: Callable[[Session, UUID, Recording], object]) -> tuple[Kind, ...]:
    """Return the kind of ingestions. ``take`` asks for what follows one."""
    return (Kind("ingest", "ingest", _end, _retry, shown_by=Recording.job_id, take=take),)
