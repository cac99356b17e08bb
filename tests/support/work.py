"""Workers in this process: every job that is there, done as a pool process does it."""

from copy import copy

from sqlalchemy import select

from service.platform.db.jobs import Job
from service.platform.db.session import Database
from service.platform.jobs.claims import claim
from service.platform.jobs.history import note
from service.platform.settings import get_settings
from tests.support.leases import let_lease_expire
from tests.support.postgres import OF_WORKERS, as_role
from workers.tasks.context import Context
from workers.tasks.running import run_job


def work(context: Context) -> None:
    """Do every job that is there, and those that follow from them, with the rights that workers have."""
    worker = copy(context)
    worker.database = Database(as_role(context.settings.database, OF_WORKERS))
    worker.database.couriers = context.database.couriers
    try:
        while True:
            with context.database.reading() as session:
                ids = session.scalars(select(Job.id).where(Job.state == "queued").order_by(Job.id)).all()
            if not ids:
                return
            for job_id in ids:
                run_job(worker, job_id)
    finally:
        worker.database.close()


def lose_every_worker(database: Database, job_id: int) -> None:
    """As if each worker that tried the job had died: the next sweep ends it."""
    assert claim(database, job_id, "dying") is not None
    let_lease_expire(database, job_id)
    with database.writing() as session:
        row = session.get_one(Job, job_id)
        for _ in range(get_settings().max_lost_leases - 1):
            note(session, row, "lost")
