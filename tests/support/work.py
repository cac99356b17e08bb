"""Workers in this process: every job that is there, done as a pool process does it."""

from sqlalchemy import select

from service.platform.db.jobs import Job
from service.platform.db.session import Database
from service.platform.jobs.claims import claim
from service.platform.jobs.history import note
from service.platform.settings import get_settings
from tests.support.leases import let_lease_expire
from workers.tasks.context import Context
from workers.tasks.running import run_job


def work(context: Context) -> None:
    """Do every job that is there, and those that follow from them."""
    while True:
        with context.database.reading() as session:
            ids = session.scalars(select(Job.id).where(Job.state == "queued").order_by(Job.id)).all()
        if not ids:
            return
        for job_id in ids:
            run_job(context, job_id)


def lose_every_worker(database: Database, job_id: int) -> None:
    """As if each worker that tried the job had died: the next sweep ends it."""
    assert claim(database, job_id, "dying") is not None
    let_lease_expire(database, job_id)
    with database.writing() as session:
        row = session.get_one(Job, job_id)
        for _ in range(get_settings().max_lost_leases - 1):
            note(session, row, "lost")
