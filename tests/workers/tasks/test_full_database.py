"""A database that is full when a job ends: the job is done later, and once."""

from __future__ import annotations

import pytest
from sqlalchemy import event, func, select

from service.platform.db.clock import now
from service.platform.db.jobs import Heartbeat, Job
from service.platform.jobs.reaper import reap
from tests.service.platform.jobs.support import let_backoff_end, make_fleet, make_jobs
from tests.support.leases import let_lease_expire
from workers.tasks.running import WORK, run_job

ROWS = 2000


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_job_that_finds_no_room_for_its_end_is_done_later_and_once(context, database, monkeypatch):
    """SQLite itself refuses a page more than there is."""
    (job_id,) = make_jobs(database, make_fleet(database), 1)

    def work(*_: object):
        return lambda session: session.add_all(Heartbeat(name=f"row {number}", at=now()) for number in range(ROWS))

    def limit(pages: int) -> None:
        def begin(connection) -> None:
            connection.connection.driver_connection.execute(f"PRAGMA max_page_count={pages}")

        event.listen(context.database.engine, "begin", begin)

    monkeypatch.setitem(WORK, "solve", work)
    limit(1)
    run_job(context, job_id)
    with context.database.reading() as session:
        assert session.get_one(Job, job_id).state in ("queued", "running")
        assert session.scalar(select(func.count()).select_from(Heartbeat)) == 0
    limit(2**30)
    let_lease_expire(database, job_id)
    reap(context.database, context.store)
    let_backoff_end(database)
    reap(context.database, context.store)
    run_job(context, job_id)
    with context.database.reading() as session:
        assert session.get_one(Job, job_id).state == "done"
        rows = select(func.count()).select_from(Heartbeat).where(Heartbeat.name.startswith("row "))
        assert session.scalar(rows) == ROWS
