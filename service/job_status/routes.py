"""Jobs as the outside sees them: what 202 answers with, and how far it is."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from typing import Annotated, Any, Literal
from uuid import UUID

from fastapi import APIRouter, Path, Query
from pydantic import computed_field
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.auth.access import ReadAccess
from service.db.base import written
from service.db.clock import utc_now
from service.db.jobs import Job
from service.http.pages import Page, Paging, fetch
from service.http.schemas import Sent

router = APIRouter(tags=["jobs"])

JobState = Literal["queued", "running", "done", "failed", "cancelled"]


# Before this share of the work, or this many seconds, what was done tells too little of what is left.
_LEAST_FRACTION, _LEAST_S = 0.02, 2.0


class JobView(Sent):
    """A unit of work. ``progress`` is {"fraction", "message"}; ``problem`` is {"code", "detail", "hint"}.

    ``seconds_left`` is about how long a running job still takes, by how far it is since it started; null where that
    is not known.
    """

    id: int
    kind: str
    state: JobState
    attempt: int
    progress: dict[str, Any] | None
    problem: dict[str, Any] | None
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None

    @computed_field
    @property
    def seconds_left(self) -> float | None:
        """See above; to the second."""
        if self.state != "running" or self.started_at is None or not self.progress:
            return None
        stated = self.progress.get("seconds_left")
        if stated is not None:
            return round(stated)
        fraction = self.progress.get("fraction") or 0.0
        passed = (utc_now() - self.started_at).total_seconds()
        if fraction < _LEAST_FRACTION or passed < _LEAST_S:
            return None
        return round(passed * (1.0 - fraction) / fraction)


def job_views(session: Session, ids: Iterable[int | None]) -> dict[int, JobView]:
    """The views of these jobs, by id."""
    wanted = {one for one in ids if one is not None}
    if not wanted:
        return {}
    return {job.id: JobView.model_validate(job) for job in session.scalars(select(Job).where(Job.id.in_(wanted)))}


@router.get("/jobs")
def get_jobs(
    access: ReadAccess,
    paging: Paging,
    fleet_id: UUID | None = None,
    state: Annotated[JobState | None, Query()] = None,
) -> Page[JobView]:
    """The jobs of the person's fleets, newest first."""
    statement = select(Job)
    if state:
        statement = statement.where(Job.state == written(state))
    scopes = access.scopes(Job, fleet_id)
    rows, following = fetch(access.session, statement, Job.id, paging, newest_first=True, any_of=scopes)
    return Page(items=[JobView.model_validate(row) for row in rows], next=following)


@router.get("/jobs/{id}")
def get_job(id: Annotated[int, Path(ge=0, lt=2**63)], access: ReadAccess) -> JobView:
    """One job."""
    return JobView.model_validate(access.find(Job, id))
