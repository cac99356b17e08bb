"""Jobs of other resources' rows, as their answers show them."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED
from service.db.jobs import Job
from service.job_status.schemas import JobView


def job_views(session: Session, ids: Iterable[int | None]) -> dict[int, JobView]:
    """The views of these jobs, by id."""
    wanted = {one for one in ids if one is not None}
    if not wanted:
        return {}
    return {job.id: JobView.model_validate(job) for job in session.scalars(select(Job).where(Job.id.in_(wanted)))}


def jobs_of(session: Session, subject_ids: Iterable[UUID]) -> dict[UUID, Job]:
    """For each subject the job that tells most: the oldest one that has not ended, else the newest."""
    found: dict[UUID, Job] = {}
    for job in session.scalars(select(Job).where(Job.subject_id.in_(list(subject_ids))).order_by(Job.id)):
        known = found.get(job.subject_id)
        if known is None or known.state not in UNENDED:
            found[job.subject_id] = job
    return found
