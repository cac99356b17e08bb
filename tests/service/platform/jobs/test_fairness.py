"""No fleet keeps another, or itself, waiting: what waits in backoff is not sent, and what runs may be capped."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import func, select, update

from service.platform.db.models import Fleet, Job
from service.platform.db.session import Database
from service.platform.jobs.claims import claim, finish, give_back, requeue_after_failure
from service.platform.jobs.reaper import reap
from service.platform.settings import get_settings
from tests.support.leases import let_lease_expire

from .support import Postbox, job, let_backoff_end, make_due, make_fleet, make_jobs


@pytest.fixture
def two_ingests(settings, monkeypatch):
    monkeypatch.setattr(get_settings(), "fleet_ingests", 2)


def claimed(database, ids):
    return [held for held in (claim(database, one, "w") for one in ids) if held]


def running(database) -> int:
    with database.reading() as session:
        return session.scalar(select(func.count()).where(Job.state == "running")) or 0


def test_jobs_in_backoff_do_not_fill_their_fleets_window(database, store):
    fleet_id = make_fleet(database)
    window = 2
    stumbling = make_jobs(database, fleet_id, window)
    others = make_jobs(database, fleet_id, window)
    postbox = Postbox(database)
    for held in claimed(database, stumbling):
        requeue_after_failure(database, held, {"code": "surroundings_failed"}, 60.0)
    assert postbox.ids == others
    reap(database, store)
    assert postbox.ids == others


def test_what_waited_in_backoff_takes_its_turn_before_what_came_later(database):
    fleet_id = make_fleet(database)
    window = 2
    first, *_ = make_jobs(database, fleet_id, window + 2)
    held = claim(database, first, "w")
    assert held
    requeue_after_failure(database, held, {"code": "surroundings_failed"}, 60.0)
    postbox = Postbox(database)
    # The window is full: it waits, and is the first to be sent when there is room.
    let_backoff_end(database)
    assert first not in postbox.ids and job(database, first).send_after is None
    with database.reading() as session:
        sent = session.scalars(select(Job.id).where(Job.sends > 0).order_by(Job.id)).first()
    held = claim(database, sent, "w")
    assert held
    requeue_after_failure(database, held, {"code": "surroundings_failed"}, 60.0)
    assert postbox.ids == [first]


def test_an_old_message_of_a_job_in_backoff_is_dropped(database):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    held = claim(database, job_id, "w")
    assert held
    requeue_after_failure(database, held, {"code": "surroundings_failed"}, 60.0)
    assert claim(database, job_id, "twin") is None
    let_backoff_end(database)
    assert claim(database, job_id, "w")


def test_a_fleet_has_no_more_ingests_running_than_its_cap_and_another_fleet_is_served(database, store, two_ingests):
    postbox = Postbox(database)
    mine = make_jobs(database, make_fleet(database, "slow"), 5, kind="ingest")
    assert postbox.ids == mine[:2]
    held = claimed(database, postbox.ids)
    assert len(held) == 2
    reap(database, store)
    assert postbox.ids == mine[:2]
    (other,) = make_jobs(database, make_fleet(database, "other"), 1, kind="ingest")
    assert postbox.ids[2:] == [other] and claim(database, other, "w")
    # One that ends, stumbles, is lost or is given back makes room for exactly one.
    finish(database, held[0])
    assert postbox.ids[3:] == [mine[2]]
    requeue_after_failure(database, held[1], {"code": "surroundings_failed"}, 60.0)
    assert postbox.ids[4:] == [mine[3]]
    third, fourth = claimed(database, mine[2:4])
    let_lease_expire(database, third.job_id)
    reap(database, store)
    # It was lost: the oldest goes first, which is itself.
    assert postbox.ids[5:] == [mine[2]]
    give_back(database, fourth)
    make_due(database)
    reap(database, store)
    assert postbox.ids[6:] == [mine[2], mine[3]]
    assert running(database) == 1


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_fleet_whose_row_somebody_holds_keeps_no_other_fleets_work_waiting(settings, database, store, two_ingests):
    fleets = [make_fleet(database, name) for name in ("held", "other")]
    jobs = [make_jobs(database, fleet, 1, kind="ingest")[0] for fleet in fleets]
    with database.writing() as session:
        session.execute(update(Job).values(sends=0, send_after=None))
    impatient = Database(settings.database, lock_s=0.2)
    postbox = Postbox(impatient)
    with database.writing() as session:
        session.execute(select(Fleet.id).where(Fleet.id == fleets[0]).with_for_update()).all()
        reap(impatient, store)
        assert postbox.ids == [jobs[1]]
    reap(impatient, store)
    assert postbox.ids == [jobs[1], jobs[0]]
    impatient.close()


def test_uploads_completed_at_the_same_moment_do_not_pass_the_cap_together(database, two_ingests):
    fleet_id = make_fleet(database)
    postbox = Postbox(database)
    barrier = threading.Barrier(8)

    def complete() -> None:
        barrier.wait()
        make_jobs(database, fleet_id, 1, kind="ingest")

    with ThreadPoolExecutor(8) as pool:
        for done in [pool.submit(complete) for _ in range(8)]:
            done.result()
    assert len(postbox.ids) == 2
    # Every finish lets out one more, also where two end at once, until all are done.
    for _ in range(4):
        held = claimed(database, postbox.ids[-2:])
        assert len(held) == 2
        with ThreadPoolExecutor(2) as pool:
            list(pool.map(lambda one: finish(database, one), held))
    assert len(postbox.ids) == 8 and running(database) == 0


def test_a_cap_that_was_lowered_lets_nothing_out_until_there_is_room(database, store, two_ingests, monkeypatch):
    fleet_id = make_fleet(database)
    postbox = Postbox(database)
    ids = make_jobs(database, fleet_id, 4, kind="ingest")
    first, second = claimed(database, ids[:2])
    monkeypatch.setattr(get_settings(), "fleet_ingests", 1)
    reap(database, store)
    finish(database, first)
    assert postbox.ids == ids[:2]
    finish(database, second)
    assert postbox.ids == ids[:3]
