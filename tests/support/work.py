"""Workers in this process: every job that is there, done as a pool process does it."""

from copy import copy

from sqlalchemy import select

from service.platform.db.grants import OF_INGEST
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
    workers = {role: copy(context) for role in (OF_WORKERS, OF_INGEST)}
    for role, worker in workers.items():
        worker.database = Database(as_role(context.settings.database, role))
        worker.database.couriers = context.database.couriers
    queued = select(Job.id, Job.queue).where(Job.state == "queued").order_by(Job.id)
    try:
        while True:
            with context.database.reading() as session:
                jobs = session.execute(queued).all()
            if not jobs:
                return
            for job_id, queue in jobs:
                run_job(workers[OF_INGEST if queue == "ingest" else OF_WORKERS], job_id)
    finally:
        for worker in workers.values():
            worker.database.close()


def lose_every_worker(database: Database, job_id: int) -> None:
    """As if each worker that tried the job had died: the next sweep ends it."""
    assert claim(database, job_id, "dying") is not None
    let_lease_expire(database, job_id)
    with database.writing() as session:
        row = session.get_one(Job, job_id)
        for _ in range(get_settings().max_lost_leases - 1):
            note(session, [row], "lost")
