"""A job in the middle of a long slot: cancelled, taken away, or given back because its worker is told to stop."""

import threading
import time
from collections.abc import Callable
from typing import Any
from unittest import mock

import pytest
from sqlalchemy import select

from service.calibrations.actions import ask_to_end
from service.platform.db.models import Calibration, CalibrationRun, Job, JobEvent, Slot
from service.platform.jobs.claims import claim
from service.platform.jobs.reaper import reap
from tests.faults.jobs import pairs
from tests.service.platform.jobs.support import make_due
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.leases import let_lease_expire
from tests.support.uploads import new_vehicle
from workers.solver import genetic
from workers.solver.genetic import evolve
from workers.solver.slot import warm_up
from workers.tasks.running import run_job

# One slot, as long as one may be.
LONG = {"slots": 1, "population": 28_000, "generations": 10_000, "max_iterations": 1}
# Of the processor: a look each half second, then the flag. The whole slot takes half a minute of it or more.
SOON_S = 4.0


@pytest.fixture
def long_job(context, fleet, engineer) -> int:
    """A job whose only slot runs for minutes."""
    warm_up()
    made = new_vehicle(engineer, fleet, "car")
    brought = bring_pairs(engineer, made["rig"], pairs(60, 1))
    ask_calibration(engineer, made["vehicle"], brought, models=["pinhole"], folds=0, schedule=LONG)
    with context.database.reading() as session:
        return session.scalars(select(Job.id)).one()


def run_until(context, job_id: int, happens: Callable[[], None]) -> float:
    """Do the job while something happens, once its slot runs; processor seconds from then to its end."""
    at: list[float] = []
    begun = threading.Event()

    def later() -> None:
        begun.wait(60)
        at.append(time.process_time())
        happens()

    def begin(*given: Any) -> Any:
        begun.set()
        return evolve(*given)

    other = threading.Thread(target=later)
    other.start()
    with mock.patch.object(genetic, "evolve", begin):
        run_job(context, job_id)
    ended = time.process_time()
    other.join()
    return ended - at[0]


def events(context, job_id: int) -> list[str]:
    with context.database.reading() as session:
        assert session.scalars(select(Slot)).all() == []
        return list(session.scalars(select(JobEvent.what).where(JobEvent.job_id == job_id).order_by(JobEvent.id)))


def test_a_cancel_ends_a_slot_that_runs(context, long_job):
    def cancel() -> None:
        with context.database.writing() as session:
            ask_to_end(session, select(Calibration.id))

    assert run_until(context, long_job, cancel) < SOON_S
    assert events(context, long_job) == ["cancelled"]
    with context.database.reading() as session:
        assert session.scalars(select(CalibrationRun.state)).one() == "cancelled"
        assert session.scalars(select(Calibration.state)).one() == "cancelled"


def test_a_lost_lease_ends_a_slot_that_runs_and_leaves_the_job_to_who_has_it(context, long_job):
    def lose() -> None:
        let_lease_expire(context.database, long_job)
        reap(context.database, context.store)
        make_due(context.database)
        assert claim(context.database, long_job, "another")

    assert run_until(context, long_job, lose) < SOON_S
    with context.database.reading() as session:
        row = session.get_one(Job, long_job)
        assert (row.state, row.worker) == ("running", "another")


def test_a_worker_that_is_told_to_stop_gives_back_a_slot_that_runs(context, long_job, told_to_stop):
    assert run_until(context, long_job, told_to_stop) < SOON_S
    assert events(context, long_job) == ["given_back"]
