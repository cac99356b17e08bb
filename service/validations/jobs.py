"""Jobs that answer a validation: one for each."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.jobs import Job
from service.platform.db.validations import Validation
from service.platform.jobs.kinds import Kind, failed_subject
from service.platform.jobs.queue import enqueue

# Job kind and queue by what is validated. Scores of pairs take milliseconds: they must not wait behind drives.
_JOBS = {
    "pairs": ("score_pairs", "report"),
    "lanes": ("check_lanes", "detect"),
    "edges": ("check_edges", "detect"),
}


def queue_validation(session: Session, row: Validation) -> Job:
    """Queue the one job of a validation whose row is there."""
    job = enqueue(session, kind=_JOBS[row.kind][0], fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = WorkState.QUEUED, None, job.id
    return job


def _end(session: Session, validation_id: UUID, state: WorkState, problem: Json | None) -> None:
    row = session.get(Validation, validation_id)
    if row is None:
        return
    row.state, row.problem = state, problem
    hint(session, row.fleet_id, "validation", row.id)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    row = failed_subject(session, job, Validation, "validation")
    hint(session, row.fleet_id, "validation", row.id)
    return [queue_validation(session, row)]


KINDS = tuple(Kind(name, queue, _end, _retry, shown_by=Validation.job_id) for name, queue in _JOBS.values())
