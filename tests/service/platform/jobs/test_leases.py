"""Which lease is lost, by the clock of who watches and by no other."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from sqlalchemy import update

from service.platform.db.clock import now
from service.platform.db.jobs import Job
from service.platform.jobs import losses
from service.platform.jobs.claims import claim
from service.platform.jobs.losses import LeaseWatch
from service.platform.jobs.reaper import reap
from service.platform.settings import get_settings
from service.platform.storage.store import Store
from tests.support.databases import one_database

from .support import Postbox, job, make_fleet, make_jobs


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    moment = [0.0]
    monkeypatch.setattr(losses, "time", SimpleNamespace(monotonic=lambda: moment[0]))
    return moment


def test_a_lease_that_keeps_its_value_is_lost_and_one_that_is_renewed_is_not(clock):
    settings, watch = get_settings(), LeaseWatch()
    silent = (1, 1, None)
    steps = round(settings.lease_s / settings.sweep_s)
    for step in range(steps):
        assert watch.lost([silent, (2, step, None)]) == []
        clock[0] += settings.sweep_s
    assert watch.lost([silent, (2, steps, None)]) == [silent]


def test_what_a_frozen_watcher_did_not_see_does_not_count(clock):
    watch = LeaseWatch()
    assert watch.lost([(1, 1, None)]) == []
    clock[0] += 3600
    assert watch.lost([(1, 1, None)]) == []


@one_database
@pytest.mark.parametrize("hours", [-1, 1])
def test_a_step_of_the_databases_clock_ends_no_lease(database, settings, hours: int):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    assert claim(database, job_id, "w")
    for _ in range(2):
        with database.writing() as session:
            session.execute(update(Job).values(lease_until=now(3600.0 * hours)))
        reap(database, Store(settings.blobs))
    assert job(database, job_id).state == "running"


@one_database
def test_after_the_databases_clock_stepped_back_what_was_sent_is_sent_again(database, settings):
    far, near = make_jobs(database, make_fleet(database), 2)
    postbox = Postbox(database)
    for job_id, ahead_s in ((far, 3600.0), (near, 60.0)):
        with database.writing() as session:
            session.execute(update(Job).where(Job.id == job_id).values(sends=1, send_after=now(ahead_s)))
    reap(database, Store(settings.blobs))
    assert postbox.ids == [far]
