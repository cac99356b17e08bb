"""The job that makes a report."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import Result
from service.platform.db.jobs import Job
from service.platform.db.reports import Report
from service.platform.jobs.kinds import Kind, failed_subject
from service.platform.jobs.queue import enqueue


def ask_report(session: Session, result: Result) -> tuple[Report, Job | None]:
    """Queue a result's report, unless one is being made. The caller holds the result's row."""
    row = session.scalars(select(Report).where(Report.result_id == result.id)).one_or_none()
    if row is None:
        row = Report(fleet_id=result.fleet_id, result_id=result.id)
        session.add(row)
        session.flush()
    elif row.state in UNENDED and row.job_id is not None:
        return row, session.get(Job, row.job_id)
    return row, _queue(session, row)


def _queue(session: Session, row: Report) -> Job:
    job = enqueue(session, kind="report", fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = WorkState.QUEUED, None, job.id
    return job


def _end(session: Session, report_id: UUID, state: WorkState, problem: Json | None) -> None:
    row = session.get(Report, report_id)
    if row is None:
        return
    row.state, row.problem = state, problem
    result = session.get_one(Result, row.result_id)
    hint(session, row.fleet_id, "calibration", result.calibration_id)


def _retry(session: Session, job: Job) -> Sequence[Job]:
    row = failed_subject(session, job, Report, "report")
    return [_queue(session, row)]


KINDS = (Kind("report", "report", _end, _retry, shown_by=Report.job_id),)
