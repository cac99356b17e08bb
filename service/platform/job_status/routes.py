"""Routes of jobs: state and progress of background work."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Path, Query
from sqlalchemy import select

from apexcal.documents.jobs import JobView, WorkerStanding
from apexcal.documents.states import WorkState
from service.platform.auth.access import ReadAccess
from service.platform.db.base import state_literal
from service.platform.db.jobs import Job
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.router import Router
from service.platform.job_status.views import job_view
from service.platform.jobs.kinds import kinds
from service.platform.jobs.queue import answering_workers

router = Router(tags=["jobs"])


@router.get("/jobs")
def get_jobs(
    access: ReadAccess,
    paging: Paging,
    fleet_id: UUID | None = None,
    state: Annotated[WorkState | None, Query()] = None,
) -> Page[JobView]:
    """The jobs of the person's fleets, newest first."""
    statement = select(Job)
    if state:
        statement = statement.where(Job.state == state_literal(state))
    scopes = access.scopes(Job, fleet_id)
    rows, following = fetch(access.session, statement, Job.id, paging, newest_first=True, any_of=scopes)
    return Page(items=[job_view(row) for row in rows], next=following)


@router.get("/jobs/{id}")
def get_job(id: Annotated[int, Path(ge=0, lt=2**63)], access: ReadAccess) -> JobView:
    """One job."""
    return job_view(access.find(Job, id))


@router.get("/workers")
def get_workers(access: ReadAccess) -> WorkerStanding:
    """Whether workers answer, and which kinds of jobs wait because none takes them."""
    queues = [worker.queues.split(",") for worker in answering_workers(access.session)]
    unserved = [kind.name for kind in kinds() if not any(kind.queue in taken for taken in queues)]
    return WorkerStanding(answering=len(queues), unserved=unserved)
