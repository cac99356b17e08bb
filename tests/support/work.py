"""Workers in this process: every job that is there, done as a pool process does it."""

from sqlalchemy import select

from service.db.jobs import Job
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
