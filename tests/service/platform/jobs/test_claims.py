"""Claim, lease, the gate of the finish."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import pytest
from sqlalchemy import func, select

from service.platform.db.clock import now
from service.platform.db.models import Calibration, Fleet
from service.platform.jobs.claims import (
    CancelledError,
    Lease,
    LostLeaseError,
    claim,
    finishing,
    requeue_after_failure,
)
from service.platform.jobs.kinds import kind_of
from service.platform.jobs.queue import cancel
from service.platform.settings import Settings, get_settings
from tests.support.processes import wait_until

from .support import job, let_backoff_end, make_calibration, make_fleet, make_jobs


@pytest.fixture
def quick(monkeypatch):
    settings = Settings(lease_s=1.0, renew_s=0.05)
    monkeypatch.setattr("service.platform.jobs.claims.get_settings", lambda: settings)
    return settings


def test_a_job_is_claimed_once_however_many_messages_arrive(database):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    won = []
    barrier = threading.Barrier(8)

    def twin(number: int) -> None:
        barrier.wait()
        won.append(claim(database, job_id, f"w{number}"))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(twin, range(8)))
    assert sum(held is not None for held in won) == 1
    assert job(database, job_id).attempt == 1


def test_a_worker_leaves_alone_what_only_newer_ones_know(database, monkeypatch):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    with monkeypatch.context() as older:
        older.setattr("service.platform.jobs.claims.kinds", lambda: [kind_of("ingest"), kind_of("detect")])
        assert claim(database, job_id, "older") is None
    assert (job(database, job_id).state, job(database, job_id).attempt) == ("queued", 0)
    assert claim(database, job_id, "newer")


def test_the_finish_writes_results_and_ends_the_job_in_one_transaction(database):
    _, (run_id,) = make_calibration(database)
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    held = claim(database, job_id, "w")
    assert held and held.payload == {"number": 0}
    with finishing(database, held) as session:
        session.add(Fleet(name="a result"))
    with database.reading() as session:
        assert session.scalar(select(func.count()).where(Fleet.name == "a result")) == 1
    assert job(database, job_id).state == "done"


def test_who_lost_the_job_cannot_finish_it(database):
    _, (run_id,) = make_calibration(database)
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    first = claim(database, job_id, "first")
    assert first
    requeue_after_failure(database, first, {}, 0.0)
    let_backoff_end(database)
    second = claim(database, job_id, "second")
    assert second and second.attempt == 2
    with pytest.raises(LostLeaseError), finishing(database, first) as session:
        session.add(Fleet(name="a ghost's result"))
    with database.reading() as session:
        assert session.scalar(select(func.count()).where(Fleet.name == "a ghost's result")) == 0
    with finishing(database, second):
        pass
    assert job(database, job_id).state == "done"


def test_a_lease_is_renewed_while_the_work_goes_on_and_carries_progress(database, quick):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    held = claim(database, job_id, "w")
    assert held
    before = job(database, job_id).lease_until
    with Lease(database, held) as lease:
        lease.report(0.5, "half way")
        deadline = time.monotonic() + 30
        while job(database, job_id).progress is None and time.monotonic() < deadline:
            time.sleep(0.02)
    after = job(database, job_id)
    assert after.progress == {"fraction": 0.5, "message": "half way"}
    assert after.lease_until > before


def test_a_cancel_is_heard_before_the_next_renewal_and_renews_nothing(database, monkeypatch):
    # A look comes every second. Whoever looked at renewals only would hear of it after minutes.
    settings = Settings(lease_s=900.0, renew_s=300.0)
    monkeypatch.setattr("service.platform.jobs.claims.get_settings", lambda: settings)
    fleet_id = make_fleet(database)
    (job_id,) = make_jobs(database, fleet_id, 1)
    held = claim(database, job_id, "w")
    assert held
    before = job(database, job_id).lease_until
    with Lease(database, held) as lease:
        with database.writing() as session:
            cancel(session, [fleet_id])
        wait_until(lambda: bool(lease.flag[0]), "the news of the cancel")
        assert job(database, job_id).lease_until == before
        with pytest.raises(CancelledError):
            lease.check()


def test_a_job_waits_longer_after_each_stumble_and_outlasts_an_outage_of_an_hour(database):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    waits: list[float] = []

    def clock():
        with database.reading() as session:
            return session.scalar(select(now()))

    for _ in range(get_settings().max_stumbles - 1):
        held = claim(database, job_id, "w")
        assert held
        before = clock()
        requeue_after_failure(database, held, {"code": "surroundings_failed"}, 2.0)
        after, send_after = clock(), job(database, job_id).send_after
        waits.append(min(2.0 * 4 ** len(waits), 128.0))
        # The stumble looked at the clock somewhere in between.
        assert before <= send_after - timedelta(seconds=waits[-1]) <= after
        let_backoff_end(database)
    assert sum(waits) > 3000


def test_what_may_be_the_jobs_own_doing_counts_as_a_lost_worker_whatever_it_stumbled_over_before(database):
    _, (run_id,) = make_calibration(database)
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    for suspect in [False] * 7 + [True] * get_settings().max_lost_leases:
        assert job(database, job_id).state == "queued"
        held = claim(database, job_id, "w")
        assert held
        requeue_after_failure(database, held, {"code": "ingest_killed"}, 0.0, suspect=suspect)
        let_backoff_end(database)
    assert (job(database, job_id).state, job(database, job_id).problem) == ("failed", {"code": "ingest_killed"})


def test_a_job_whose_surroundings_always_fail_ends_with_the_reason(database):
    calibration_id, (run_id,) = make_calibration(database)
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    for _ in range(get_settings().max_stumbles):
        held = claim(database, job_id, "w")
        assert held
        requeue_after_failure(database, held, {"code": "surroundings_failed"}, 0.0)
        let_backoff_end(database)
    assert (job(database, job_id).state, job(database, job_id).problem) == ("failed", {"code": "surroundings_failed"})
    assert claim(database, job_id, "w") is None
    with database.reading() as session:
        assert session.get_one(Calibration, calibration_id).state == "failed"
