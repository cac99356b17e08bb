"""Jobs as the answers show them."""

from __future__ import annotations

from collections.abc import Iterable
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.jobs import JobView
from apexcal.documents.states import UNENDED, WorkState
from service.db.clock import utc_now
from service.db.jobs import Job

# Below this share of the work, or this many seconds, an estimate of the rest is unreliable.
_LEAST_FRACTION, _LEAST_S = 0.02, 2.0


def job_view(job: Job) -> JobView:
    """A job."""
    view = JobView.model_validate(job)
    view.seconds_left = _seconds_left(job)
    return view


def job_views(session: Session, ids: Iterable[int | None]) -> dict[int, JobView]:
    """The views of these jobs, by id."""
    wanted = {one for one in ids if one is not None}
    if not wanted:
        return {}
    return {job.id: job_view(job) for job in session.scalars(select(Job).where(Job.id.in_(wanted)))}


def jobs_of(session: Session, subject_ids: Iterable[UUID]) -> dict[UUID, Job]:
    """For each subject the job that tells most: the oldest one that has not ended, else the newest."""
    found: dict[UUID, Job] = {}
    for job in session.scalars(select(Job).where(Job.subject_id.in_(list(subject_ids))).order_by(Job.id)):
        known = found.get(job.subject_id)
        if known is None or known.state not in UNENDED:
            found[job.subject_id] = job
    return found


def _seconds_left(job: Job) -> float | None:
    """About how long a running job still takes, to the second; None where that is not known."""
    if job.state != WorkState.RUNNING or job.started_at is None or not job.progress:
        return None
    stated = job.progress.get("seconds_left")
    if stated is not None:
        return round(stated)
    fraction = job.progress.get("fraction") or 0.0
    passed = (utc_now() - job.started_at).total_seconds()
    if fraction < _LEAST_FRACTION or passed < _LEAST_S:
        return None
    return round(passed * (1.0 - fraction) / fraction)
