"""The sweep finds what was lost, never sent, cancelled or left over."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from types import SimpleNamespace

import pytest
from sqlalchemy import delete, select, update
from sqlalchemy.exc import OperationalError

from service.platform.db.clock import now
from service.platform.db.models import Blob, Calibration, CalibrationRun, Fleet
from service.platform.db.session import Database
from service.platform.jobs import reaper as reaper_module
from service.platform.jobs.claims import CancelledError, claim, finishing
from service.platform.jobs.queue import cancel, enqueue
from service.platform.jobs.reaper import reap
from service.platform.settings import get_settings
from service.platform.storage.blobs import condemn, keep, reserve
from service.platform.storage.store import MARKER
from tests.support.databases import wait_until_one_waits
from tests.support.leases import let_lease_expire

from .support import Postbox, job, make_calibration, make_due, make_fleet, make_jobs, statements, states


def lost_jobs(database, *jobs):
    """Jobs whose workers were silent for longer than their leases; new ones where none is named."""
    jobs = jobs or make_jobs(database, make_fleet(database), 1)
    for job_id in jobs:
        assert claim(database, job_id, "w")
        let_lease_expire(database, job_id)
    return jobs


def test_an_expired_lease_is_queued_and_sent_again_at_once(database, store):
    (job_id,) = lost_jobs(database)
    postbox = Postbox(database)
    reap(database, store)
    assert (job(database, job_id).state, job(database, job_id).lost) == ("queued", 1)
    assert postbox.ids == [job_id]


def test_jobs_that_cannot_be_decided_keep_the_sweep_from_no_other(database, store, monkeypatch):
    monkeypatch.setattr(reaper_module, "_BATCH", 2)
    *stuck, last = make_jobs(database, make_fleet(database), 4)
    recover = reaper_module._recover

    def decide(session, row):
        if row.id in stuck:
            raise RuntimeError
        recover(session, row)

    monkeypatch.setattr(reaper_module, "_recover", decide)
    lost_jobs(database, *stuck, last)
    reap(database, store)
    assert states(database) == ["running"] * 3 + ["queued"]


def test_a_step_that_fails_keeps_no_other_from_being_done(database, store, monkeypatch):
    def fail(_):
        raise RuntimeError("this step")

    for name in ("_beat", "_end_cancelled", "tally", "_send_again"):
        monkeypatch.setattr(reaper_module, name, fail)
    (lost,) = lost_jobs(database)
    with database.writing() as session:
        condemned = reserve(session, "recordings/a")
        condemn(session, [condemned])
    store.put_bytes(condemned, b"x")
    with pytest.raises(RuntimeError, match="this step"):
        reap(database, store)
    assert job(database, lost).state == "queued"
    assert store.local_path(condemned) is None


def test_a_database_that_is_away_ends_the_sweep_at_once(store, tmp_path, monkeypatch):
    away = Database(f"sqlite:///{tmp_path / 'no such folder' / 'apexcal.db'}")
    tried = []
    monkeypatch.setattr(reaper_module, "log", SimpleNamespace(exception=tried.append))
    with pytest.raises(OperationalError):
        reap(away, store)
    assert not tried


def test_decisions_that_take_long_keep_the_sweep_no_longer_than_two_periods(database, store, monkeypatch):
    lost_jobs(database, *make_jobs(database, make_fleet(database), 4))
    clock = [0.0]
    recover = reaper_module._recover

    def decide(session, row):
        clock[0] += 1.5 * get_settings().sweep_s
        recover(session, row)

    monkeypatch.setattr(reaper_module, "_recover", decide)
    monkeypatch.setattr(reaper_module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    reap(database, store)
    assert states(database) == ["queued"] * 2 + ["running"] * 2
    reap(database, store)
    assert states(database) == ["queued"] * 4


def test_a_job_that_kills_every_worker_fails_with_its_reason_and_ends_its_parents(database, store):
    calibration_id, (run_id, other) = make_calibration(database, models=("pinhole", "kannala_brandt"))
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    for _ in range(get_settings().max_lost_leases):
        lost_jobs(database, job_id)
        reap(database, store)
    row = job(database, job_id)
    assert row.state == "failed"
    assert row.problem["code"] == "worker_lost"
    assert "5 times" in row.problem["detail"]
    with database.reading() as session:
        run = session.get_one(CalibrationRun, run_id)
        assert (run.state, run.problem["code"]) == ("failed", "worker_lost")
        assert session.get_one(CalibrationRun, other).state == "queued"
        assert session.get_one(Calibration, calibration_id).remaining == 1


def test_what_was_never_claimed_is_sent_again_twice_as_late_each_time(database, store):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    for longer in (2, 4, 8):
        make_due(database)
        postbox = Postbox(database)
        before = _clock(database)
        reap(database, store)
        assert postbox.ids == [job_id]
        # The sweep looked at the clock somewhere in between.
        began = job(database, job_id).send_after - timedelta(seconds=longer * get_settings().resend_s)
        assert before <= began <= _clock(database)
    postbox = Postbox(database)
    reap(database, store)
    assert not postbox.sent


def _clock(database):
    with database.reading() as session:
        return session.scalar(select(now()))


def test_a_cancel_ends_queued_jobs_and_their_parents_once(database, store):
    calibration_id, runs = make_calibration(database, models=("pinhole", "kannala_brandt"))
    fleet_id = make_fleet(database, "other")
    for run_id in runs:
        make_jobs(database, fleet_id, 2, run_id)
    with database.writing() as session:
        cancel(session, runs)
    reap(database, store)
    reap(database, store)
    assert states(database) == ["cancelled"] * 4
    with database.reading() as session:
        calibration = session.get_one(Calibration, calibration_id)
        assert (calibration.state, calibration.remaining) == ("cancelled", 0)


def test_a_job_that_follows_the_one_that_a_cancel_waits_for_is_cancelled_too(database, store):
    calibration_id, (run_id,) = make_calibration(database)
    fleet_id = make_fleet(database, "other")
    (first,) = make_jobs(database, fleet_id, 1, run_id)

    def cancel_it():
        with database.writing() as session:
            cancel(session, [run_id])

    held, canceller = claim(database, first, "w"), threading.Thread(target=cancel_it)
    with finishing(database, held) as session:
        canceller.start()
        wait_until_one_waits(database)
        enqueue(session, kind="solve", fleet_id=fleet_id, subject_id=run_id)
    canceller.join()
    reap(database, store)
    assert states(database) == ["done", "cancelled"]
    with database.reading() as session:
        assert session.get_one(Calibration, calibration_id).state == "cancelled"


def test_a_job_whose_end_was_asked_for_is_not_done(database):
    """Else another could follow it, of which the cancel knew nothing."""
    (job_id,) = make_jobs(database, fleet_id := make_fleet(database), 1)
    held = claim(database, job_id, "w")
    with database.writing() as session:
        cancel(session, [fleet_id])
    with pytest.raises(CancelledError), finishing(database, held):
        pass
    assert states(database) == ["running"]


def test_many_cancelled_jobs_end_in_as_many_statements_as_two(database, store):
    seen = []
    for models in (("pinhole", "kannala_brandt"), ("a", "b", "c", "d", "e", "f")):
        with database.writing() as session:
            session.execute(delete(Fleet))
        calibration_id, runs = make_calibration(database, models=models)
        for run_id in runs:
            make_jobs(database, make_fleet(database, f"fleet of {run_id}"), 2, run_id)
        with database.writing() as session:
            cancel(session, runs)
        with statements(database) as asked:
            reaper_module._end_cancelled(database)
        seen.append(asked)
        with database.reading() as session:
            calibration = session.get_one(Calibration, calibration_id)
            assert (calibration.state, calibration.remaining) == ("cancelled", 0)
    assert seen[0] == seen[1]


def test_a_cancelled_job_that_does_not_end_keeps_no_other_from_it(database, store, monkeypatch):
    stuck, *others = make_jobs(database, fleet_id := make_fleet(database), 3)
    end = reaper_module.end

    def end_but_one(session, jobs, state):
        if stuck in session.scalars(jobs).all():
            raise RuntimeError
        return end(session, jobs, state)

    monkeypatch.setattr(reaper_module, "end", end_but_one)
    with database.writing() as session:
        cancel(session, [fleet_id])
    reap(database, store)
    assert states(database) == ["queued", "cancelled", "cancelled"] and others


def test_two_sweeps_at_once_do_no_harm(database, store):
    calibration_id, runs = make_calibration(database, models=("pinhole", "kannala_brandt", "brown_conrady"))
    fleet_id = make_fleet(database, "other")
    for run_id in runs:
        make_jobs(database, fleet_id, 1, run_id)
    with database.writing() as session:
        cancel(session, runs)
    with ThreadPoolExecutor(4) as pool:
        for done in [pool.submit(reap, database, store) for _ in range(4)]:
            done.result()
    with database.reading() as session:
        assert session.get_one(Calibration, calibration_id).remaining == 0


def test_blobs_whose_work_was_lost_are_removed_and_won_ones_stay(database, store):
    (lost, running) = make_jobs(database, make_fleet(database), 2)
    first = claim(database, lost, "w")
    second = claim(database, running, "w")
    assert first and second
    with database.writing() as session:
        gone = reserve(session, "recordings/a", job_id=lost, attempt=1)
        working = reserve(session, "recordings/b", job_id=running, attempt=1)
        won = reserve(session, "recordings/c", job_id=lost, attempt=1)
        keep(session, won, size=1)
    for key in (gone, working, won):
        store.put_bytes(key, b"x")
    let_lease_expire(database, lost)
    reap(database, store)
    with database.reading() as session:
        assert set(session.scalars(select(Blob.key))) == {working, won}
    assert store.local_path(gone) is None
    assert store.local_path(working) and store.local_path(won)


def test_an_object_that_cannot_be_removed_keeps_no_other_from_it(database, store, caplog):
    with database.writing() as session:
        stuck, *others = [reserve(session, "recordings/a") for _ in range(5)]
        condemn(session, [stuck, *others])
    for key in others:
        store.put_bytes(key, b"x")
    # A folder of that name is no object, and no store removes it.
    (store.folder / stuck / "in the way").mkdir(parents=True)
    for _ in range(3):
        reap(database, store)
    assert not any(store.local_path(key) for key in others)
    with database.reading() as session:
        (left,) = session.scalars(select(Blob)).all()
        late = (left.remove_after - session.scalar(select(now()))).total_seconds()
    assert (left.key, left.state, left.failed_removals) == (stuck, "condemned", 1) and 0 < late <= 10
    assert caplog.text.count(f"object {stuck} could not be removed") == 1
    # Its turn comes again, each time later; then it goes.
    for failures in (2, 3):
        let_removals_be_due(database)
        reap(database, store)
        with database.reading() as session:
            assert session.get_one(Blob, stuck).failed_removals == failures
    (store.folder / stuck / "in the way").rmdir()
    (store.folder / stuck).rmdir()
    let_removals_be_due(database)
    reap(database, store)
    with database.reading() as session:
        assert session.scalars(select(Blob)).all() == []


def let_removals_be_due(database):
    with database.writing() as session:
        session.execute(update(Blob).values(remove_after=now(-1)))


def test_a_store_that_is_away_is_asked_for_three_objects_and_no_more(database, store):
    with database.writing() as session:
        condemn(session, [reserve(session, "recordings/a") for _ in range(20)])
    (store.folder / MARKER).unlink()
    reap(database, store)
    with database.reading() as session:
        tried = [blob.failed_removals for blob in session.scalars(select(Blob))]
    assert (len(tried), sum(tried)) == (20, 3)
    store.prepare()
    let_removals_be_due(database)
    reap(database, store)
    with database.reading() as session:
        assert session.scalars(select(Blob)).all() == []


def test_a_job_whose_parent_is_gone_ends_and_keeps_nobody_waiting(database, store):
    _, (run_id,) = make_calibration(database)
    fleet_id = make_fleet(database, "other")
    (orphan,) = make_jobs(database, fleet_id, 1, run_id)
    (innocent,) = make_jobs(database, fleet_id, 1)
    with database.writing() as session:
        session.execute(delete(CalibrationRun))
        cancel(session, [run_id])
    make_due(database)
    postbox = Postbox(database)
    reap(database, store)
    assert job(database, orphan).state == "cancelled"
    assert postbox.ids == [innocent]
