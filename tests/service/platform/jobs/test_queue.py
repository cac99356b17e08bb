"""Enqueue, the window of each fleet, cancel, abandon."""

from __future__ import annotations

import pytest
from sqlalchemy import select

from service.platform.db.clock import now
from service.platform.db.models import Job, Worker
from service.platform.jobs.claims import claim
from service.platform.jobs.queue import abandon, cancel, enqueue, live_processes, release

from .support import Postbox, job, make_calibration, make_fleet, make_jobs, states


def test_messages_go_out_after_the_commit_and_not_before(database):
    postbox = Postbox(database)
    fleet_id = make_fleet(database)
    with database.writing() as session:
        job_id = enqueue(session, kind="solve", fleet_id=fleet_id, subject_id=fleet_id).id
        assert not postbox.sent
    assert postbox.sent == [(job_id, "solve")]


def test_a_rolled_back_transaction_sends_nothing(database):
    postbox = Postbox(database)
    _, (run_id,) = make_calibration(database)
    fleet_id = make_fleet(database, "second")
    with pytest.raises(RuntimeError), database.writing() as session:
        enqueue(session, kind="solve", fleet_id=fleet_id, subject_id=run_id)
        raise RuntimeError
    assert not postbox.sent
    assert states(database) == []


def test_a_fleet_has_a_window_of_the_live_processes_and_the_rest_waits_oldest_first(database):
    """Also for workers that came after the jobs did."""
    postbox = Postbox(database)
    fleet_id = make_fleet(database)
    ids = make_jobs(database, fleet_id, 9)
    assert postbox.ids == ids[:2], "nobody answers"
    workers = (("a", "solve", 0), ("b", "report,solve", 0), ("silent", "solve", -60), ("d", "detect", 0))
    with database.writing() as session:
        for name, queues, seconds in workers:
            times = {"started_at": now(), "at": now(seconds)}
            session.add(Worker(name=name, queues=queues, processes=3, version="1", warm=True, **times))
        session.flush()
        assert (live_processes(session, "solve"), live_processes(session, "report")) == (6, 3)
        release(session, fleet_id, "solve")
    assert postbox.ids == ids[:6]
    assert all(job(database, waiting).send_after is None for waiting in ids[6:])


def test_a_second_fleet_is_sent_at_once_beside_a_full_window(database):
    postbox = Postbox(database)
    make_jobs(database, make_fleet(database, "large"), 50)
    sent = len(postbox.sent)
    (small,) = make_jobs(database, make_fleet(database, "small"), 1)
    assert postbox.ids[sent:] == [small]


def test_cancel_flags_and_a_flagged_job_is_not_claimed(database):
    fleet_id = make_fleet(database)
    ids = make_jobs(database, fleet_id, 1)
    with database.writing() as session:
        cancel(session, [fleet_id])
    assert job(database, ids[0]).cancel_requested
    assert claim(database, ids[0], "w") is None


def test_abandon_ends_jobs_without_telling_a_parent_that_is_gone(database):
    fleet_id = make_fleet(database)
    ids = make_jobs(database, fleet_id, 2)
    held = claim(database, ids[0], "w")
    with database.writing() as session:
        abandon(session, [fleet_id])
    assert states(database) == ["cancelled", "cancelled"]
    assert held is not None
    with database.reading() as session:
        assert session.scalars(select(Job.lease_until)).all() == [None, None]
