"""Jobs as the answers show them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.jobs import JobView
from apexcal.documents.states import UNENDED, WorkState
from service.platform.db.clock import utc_now
from service.platform.db.jobs import Job

# Below this share of the work, or this many seconds, an estimate of the rest is unreliable.
_LEAST_FRACTION, _LEAST_S = 0.02, 2.0


def job_view(job: Job) -> JobView:
    """A job."""
    view = JobView.model_validate(job)
    view.seconds_left = _seconds_left(job)
    return view


def job_views(session: Session, ids: Iterable[int | None]) -> dict[int, JobView]:
    """The views of these jobs, by id."""
    numbers = {id for id in ids if id is not None}
    if not numbers:
        return {}
    return {job.id: job_view(job) for job in session.scalars(select(Job).where(Job.id.in_(numbers)))}


def jobs_of(session: Session, subject_ids: Iterable[UUID]) -> dict[UUID, Job]:
    """Return the most relevant job of each subject.

    It is the oldest one that has not ended, else the newest that failed and whose work no later one did, else the
    newest.
    """
    latest: dict[UUID, dict[str, Job]] = {}
    for job in session.scalars(select(Job).where(Job.subject_id.in_(list(subject_ids))).order_by(Job.id)):
        work = json.dumps([job.kind, job.payload], sort_keys=True)
        latest.setdefault(job.subject_id, {})[work] = job
    return {
        subject: _most_relevant(sorted(jobs.values(), key=lambda job: job.id)) for subject, jobs in latest.items()
    }


def _most_relevant(jobs: Sequence[Job]) -> Job:
    unended = next((job for job in jobs if job.state in UNENDED), None)
    return unended or next((job for job in reversed(jobs) if job.state == WorkState.FAILED), jobs[-1])


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
