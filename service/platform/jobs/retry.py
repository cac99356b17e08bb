"""Starts failed work again from its beginning, with fresh jobs, in one transaction.

The failed job keeps its history. The results are the same as a first try's.
"""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import exists, select
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.platform.db.jobs import Job
from service.platform.jobs.history import note
from service.platform.jobs.kinds import CannotRetryError, kind_of


def retry(session: Session, job_id: int) -> Sequence[Job]:
    """Start a failed job's work anew and return the fresh jobs. Raises :class:`CannotRetryError`."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is None:
        raise CannotRetryError(f"there is no job {job_id}")
    if job.state != WorkState.FAILED:
        raise CannotRetryError(f"job {job_id} is {job.state}; only failed ones are started again")
    again = kind_of(job.kind).retry
    if again is None:
        raise CannotRetryError(f"work of the kind {job.kind} is not started again by itself; ask for it anew")
    under_way = exists().where(Job.subject_id == job.subject_id, Job.state.in_(UNENDED))
    if session.scalar(select(under_way)):
        raise CannotRetryError("other jobs of the same work are under way; wait for their end")
    fresh = again(session, job)
    note(session, job, "requeued", job.problem)
    return fresh
