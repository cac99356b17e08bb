"""A database that takes no writes, as in a failover's moment: requests are told to wait, jobs are done later."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import psycopg
import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from service.platform.db.clock import now
from service.platform.db.jobs import Heartbeat, Job
from service.platform.db.session import Database
from service.platform.jobs.reaper import reap
from tests.service.platform.jobs.support import let_backoff_end, make_fleet, make_jobs
from tests.support.leases import let_lease_expire
from tests.support.postgres import Postgres
from tests.support.processes import wait_until
from workers.tasks.running import WORK, run_job

pytestmark = pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)


@contextmanager
def read_only(postgres: Postgres, database: Database) -> Iterator[None]:
    """Let the server refuse all writes for a block, on connections that are open too."""

    def turn(value: str) -> None:
        session.execute(f"ALTER SYSTEM SET default_transaction_read_only = {value}".encode())
        session.execute("SELECT pg_reload_conf()")

        def has_turned() -> bool:
            with database.alone() as connection:
                return connection.scalar(text("SHOW default_transaction_read_only")) == value

        wait_until(has_turned, f"default_transaction_read_only {value}")

    address = f"host={postgres.folder} user=postgres dbname=postgres"
    with psycopg.connect(address, autocommit=True, options="-c default_transaction_read_only=off") as session:
        try:
            turn("on")
            yield
        finally:
            turn("off")


def test_a_write_is_told_to_wait_and_a_read_is_answered(postgres, api, engineer, fleet):
    path = f"/fleets/{fleet}/vehicles"
    with read_only(postgres, api.database):
        refused = [engineer.post(path, {"name": "van"}) for _ in range(3)]
        assert engineer.get(path).json()["items"] == []
    for answer in refused:
        assert (answer.status_code, answer.json()["code"]) == (503, "database_read_only")
        assert answer.headers["Retry-After"] == "2"
    assert engineer.post(path, {"name": "van"}).status_code == 201


@pytest.mark.parametrize("already_claimed", [True, False])
def test_a_job_goes_back_and_is_done_once_the_database_takes_writes(
    postgres, context, database, monkeypatch, already_claimed
):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    moments = [read_only(postgres, context.database)]

    def work(*_: object):
        if moments:
            failover.enter_context(moments.pop())
        return lambda session: session.add(Heartbeat(name="row", at=now()))

    monkeypatch.setitem(WORK, "solve", work)
    with ExitStack() as failover:
        if not already_claimed:
            failover.enter_context(moments.pop())
        run_job(context, job_id, "solve")
        with pytest.raises(OperationalError, match="read-only"):
            reap(context.database, context.store)
    with database.reading() as session:
        job = session.get_one(Job, job_id)
        assert (job.state, job.problem) == ("running" if already_claimed else "queued", None)
    let_lease_expire(database, job_id)
    reap(context.database, context.store)
    let_backoff_end(database)
    reap(context.database, context.store)
    run_job(context, job_id)
    with database.reading() as session:
        assert (session.get_one(Job, job_id).state, session.get_one(Heartbeat, "row").name) == ("done", "row")
