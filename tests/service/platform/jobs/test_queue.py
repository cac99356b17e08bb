"""Enqueue, the window of each fleet, cancel, abandon."""

from __future__ import annotations

import pytest
from sqlalchemy import select

from service.platform.db.models import Job
from service.platform.jobs.claims import claim
from service.platform.jobs.queue import abandon, cancel, enqueue
from service.platform.settings import get_settings

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


def test_a_fleet_has_a_window_and_the_rest_waits_oldest_first(database):
    postbox = Postbox(database)
    fleet_id = make_fleet(database)
    window = get_settings().workers
    ids = make_jobs(database, fleet_id, window + 3)
    assert postbox.ids == ids[:window]
    assert all(job(database, waiting).send_after is None for waiting in ids[window:])


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
