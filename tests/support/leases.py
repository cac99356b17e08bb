"""Leases of workers that died, without waiting for it."""

from sqlalchemy import select

from service.platform.db.jobs import Job
from service.platform.db.session import Database
from service.platform.jobs.reaper import LEASES


def let_lease_expire(database: Database, job_id: int) -> None:
    """As if this process had seen the worker silent for longer than its lease."""
    with database.reading() as session:
        lease = session.execute(select(Job.id, Job.attempt, Job.lease_until).where(Job.id == job_id)).one()
    LEASES._since[tuple(lease)] = -1e9
