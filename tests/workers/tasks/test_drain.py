"""A worker that is told to stop gives its job back, wherever the signal meets it."""

import signal
from unittest import mock

import pytest
from sqlalchemy import select, text
from sqlalchemy.exc import ProgrammingError

from service.platform.db.models import Job, JobEvent
from service.platform.jobs.claims import Lease
from tests.service.platform.jobs.support import make_calibration, make_fleet, make_jobs
from tests.support.processes import wait_until
from workers.tasks import drain, running


def outcome(database, job_id):
    with database.reading() as session:
        row = session.get_one(Job, job_id)
        what = session.scalars(select(JobEvent.what).where(JobEvent.job_id == job_id)).all()
        return row.state, row.lost, row.problem, list(what)


@pytest.mark.parametrize("turned", [False, True])
def test_a_job_is_given_back_also_where_a_driver_turns_the_interruption_into_an_error(
    context, told_to_stop, monkeypatch, turned
):
    _, (run_id,) = make_calibration(context.database)
    (job_id,) = make_jobs(context.database, make_fleet(context.database, "other"), 1, run_id)

    def work(context, held, lease):
        with context.database.reading() as session:
            session.execute(text("SELECT 1"))
            try:
                told_to_stop()
            except drain.DrainedError:
                if turned:
                    raise ProgrammingError("SELECT 1", {}, Exception("connection in status ACTIVE")) from None
                raise
        raise AssertionError("the signal interrupts")

    monkeypatch.setitem(running.WORK, "solve", work)
    running.run_job(context, job_id)
    assert outcome(context.database, job_id) == ("queued", 0, None, ["given_back"])
    running.run_job(context, job_id)
    assert outcome(context.database, job_id)[0] == "queued", "who is told to stop begins nothing more"


def test_a_kernel_is_stopped_though_the_main_thread_gets_no_turn(told_to_stop):
    signal.signal(drain.DRAIN_SIGNAL, lambda *_: None)  # Python's handler says nothing while a kernel runs
    lease = Lease(mock.Mock(), mock.Mock())
    with drain.interruptible(lease):
        told_to_stop()
        wait_until(lambda: bool(lease.flag[0]), "the flag that kernels look at", 5.0)
    with pytest.raises(drain.DrainedError):
        lease.check()
