"""Removes ended jobs and their history after a while; the totals keep counting them."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import delete, exists, func, or_, select
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED
from service.platform.db.clock import now
from service.platform.db.jobs import Job, JobEvent, Worker
from service.platform.db.session import Database
from service.platform.jobs.kinds import kinds
from service.platform.settings import get_settings

_BATCH = 1000
# Silence after which a worker is taken not to come back under its name.
_GONE = timedelta(hours=1)


def forget_jobs(database: Database) -> int:
    """Remove the jobs that ended over ``job_days`` ago, with what their kinds forget, and return how many.

    A job that its subject still shows stays, and so does one with events that the totals do not count yet.
    """
    removed = 0
    while True:
        with database.writing() as session:
            jobs = session.execute(_overdue().limit(_BATCH)).all()
            ids = [id for id, _, _ in jobs]
            for kind in kinds():
                if kind.forget:
                    kind.forget(session, {subject for _, name, subject in jobs if name == kind.name})
            session.execute(delete(Job).where(Job.id.in_(ids)).execution_options(synchronize_session=False))
        removed += len(ids)
        if len(ids) < _BATCH:
            return removed


def overdue_jobs(session: Session) -> int:
    """How many jobs :func:`forget_jobs` would remove."""
    return session.scalar(select(func.count()).select_from(_overdue().subquery())) or 0


def _overdue():  # noqa: ANN202 - a statement
    columns = dict.fromkeys(kind.shown_by for kind in kinds() if kind.shown_by is not None)
    shown = or_(*(exists().where(Job.id == column) for column in columns))
    untallied = exists().where(JobEvent.job_id == Job.id, ~JobEvent.tallied)
    ended = now(-86400.0 * get_settings().job_days)
    # With `in_` the ended states SQLite would look at all jobs that ended, instead of using the index of the times.
    overdue = (Job.state.not_in(UNENDED), Job.finished_at < ended, ~shown, ~untallied)
    return select(Job.id, Job.kind, Job.subject_id).where(*overdue).order_by(Job.finished_at)


def forget_workers(session: Session) -> None:
    """Remove workers that have been silent for an hour."""
    session.execute(
        delete(Worker).where(Worker.at < now(-_GONE.total_seconds())).execution_options(synchronize_session=False)
    )
