"""The fan-in: the last bundle goes on, whoever it is, and a run ends once."""

from __future__ import annotations

import threading

from sqlalchemy import func, select

from service.calibration_runs.actions import end_runs, start_runs
from service.platform.db.models import Calibration, CalibrationRun, Fleet, Job
from service.platform.jobs.claims import CancelledError, claim, finishing
from service.platform.jobs.queue import cancel
from service.platform.jobs.reaper import reap
from service.platform.jobs.tree import count_down
from tests.service.platform.jobs.support import make_calibration
from tests.support.folders import folder_store


def _start(database, run_id):
    with database.writing() as session:
        start_runs(session, [session.get_one(CalibrationRun, run_id)])
    with database.reading() as session:
        return session.scalars(select(Job.id).order_by(Job.id)).all()


def test_an_iteration_is_fixed_rows_of_bundles(database):
    _, (run_id,) = make_calibration(database, slots=5, bundle=2)
    ids = _start(database, run_id)
    with database.reading() as session:
        payloads = [session.get_one(Job, job_id).payload for job_id in ids]
        assert [(p["first"], p["stop"]) for p in payloads] == [(0, 2), (2, 4), (4, 5)]
        assert session.get_one(CalibrationRun, run_id).remaining == 3


def test_the_last_two_bundles_finishing_at_the_same_moment_start_one_next_iteration(database):
    for _ in range(5):
        _, (run_id,) = make_calibration_named(database)
        ids = _start(database, run_id)[-2:]
        barrier = threading.Barrier(2)
        went_on: list[int] = []

        def finish(job_id: int, run_id=run_id, barrier=barrier, went_on=went_on) -> None:
            held = claim(database, job_id, f"w{job_id}")
            assert held
            barrier.wait()
            with finishing(database, held) as session:
                if begin_next_iteration(session, run_id):
                    went_on.append(job_id)

        threads = [threading.Thread(target=finish, args=(job_id,)) for job_id in ids]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(went_on) == 1
        with database.reading() as session:
            run = session.get_one(CalibrationRun, run_id)
            assert (run.iteration, run.remaining) == (1, 2)
            queued = session.scalar(
                select(func.count()).select_from(Job).where(Job.subject_id == run_id, Job.state == "queued")
            )
            assert queued == 2


def begin_next_iteration(session, run_id) -> bool:
    """As the last bundle of a run does it; whether it was the last."""
    if not count_down(session, CalibrationRun, [run_id]):
        return False
    run = session.get_one(CalibrationRun, run_id, populate_existing=True)
    run.iteration += 1
    start_runs(session, [run])
    return True


_numbers = iter(range(1000))


def make_calibration_named(database):
    """Each in a fleet of its own."""
    made = make_calibration(database)
    with database.writing() as session:
        for fleet in session.scalars(select(Fleet).where(Fleet.name == "fleet")):
            fleet.name = f"fleet {next(_numbers)}"
    return made


def test_a_cancel_against_the_last_finish_leaves_nothing_waiting(database, tmp_path):
    store = folder_store(tmp_path / "blobs")
    for _ in range(5):
        calibration_id, (run_id,) = make_calibration_named(database)
        first, last = _start(database, run_id)[-2:]
        _finish(database, first, run_id)
        barrier = threading.Barrier(2)

        def cancel_it(run_id=run_id, barrier=barrier) -> None:
            barrier.wait()
            with database.writing() as session:
                cancel(session, [run_id])

        held = claim(database, last, "w")
        canceller = threading.Thread(target=cancel_it)
        canceller.start()
        barrier.wait()
        _finish(database, last, run_id, held)
        canceller.join()
        reap(database, store)
        with database.reading() as session:
            assert session.get_one(Calibration, calibration_id).state == "cancelled"
            waiting = select(func.count()).select_from(Job).where(Job.subject_id == run_id, Job.finished_at.is_(None))
            assert session.scalar(waiting) == 0


def _finish(database, job_id, run_id, held=None) -> None:
    """As the worker does it: the last bundle goes on, unless its end was asked for."""
    held = held or claim(database, job_id, "w")
    assert held
    try:
        with finishing(database, held) as session:
            begin_next_iteration(session, run_id)
    except CancelledError:
        with finishing(database, held, "cancelled"):
            pass


def test_a_run_ends_once_and_the_last_run_ends_the_calibration(database):
    calibration_id, (first, second) = make_calibration(database, models=("pinhole", "kannala_brandt"))
    with database.writing() as session:
        end_runs(session, [first], "failed", {"code": "a"})
        end_runs(session, [first], "failed", {"code": "b"})
    with database.reading() as session:
        assert session.get_one(Calibration, calibration_id).remaining == 1
        assert session.get_one(CalibrationRun, first).problem == {"code": "a"}
    with database.writing() as session:
        end_runs(session, [second], "failed", {"code": "c"})
    with database.reading() as session:
        calibration = session.get_one(Calibration, calibration_id)
        assert (calibration.remaining, calibration.state) == (0, "failed")
        assert calibration.problem["code"] in ("a", "c")


def test_a_bundle_of_a_run_that_ended_counts_nothing(database):
    _, (run_id,) = make_calibration(database)
    _start(database, run_id)
    with database.writing() as session:
        end_runs(session, [run_id], "cancelled")
    with database.writing() as session:
        assert count_down(session, CalibrationRun, [run_id]) == []
