"""What became of each attempt is on record, whoever ended it."""

from __future__ import annotations

import pytest
from sqlalchemy import select

from service.platform.db.models import Job, JobEvent
from service.platform.jobs.claims import claim, finishing, give_back, requeue_after_failure
from service.platform.jobs.queue import abandon
from service.platform.jobs.reaper import reap
from service.platform.observability.request_ids import working_for
from service.platform.storage.store import Store
from tests.support.leases import let_lease_expire

from .support import let_backoff_end, make_calibration, make_fleet, make_jobs, states


def history(database, job_id: int) -> list[tuple]:
    with database.reading() as session:
        asked = select(JobEvent).where(JobEvent.job_id == job_id).order_by(JobEvent.id)
        return [(row.attempt, row.what, row.worker, row.reason) for row in session.scalars(asked)]


def test_a_job_remembers_who_gave_it_back_who_lost_it_and_who_did_it(database, settings):
    _, (run_id,) = make_calibration(database)
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    drained = claim(database, job_id, "drained")
    give_back(database, drained)
    requeue_after_failure(database, claim(database, job_id, "unlucky"), {"code": "surroundings_failed"}, 0.0)
    let_backoff_end(database)
    assert claim(database, job_id, "dead")
    let_lease_expire(database, job_id)
    reap(database, Store(settings.blobs))
    with finishing(database, claim(database, job_id, "good")):
        pass
    give_back(database, drained)
    assert history(database, job_id) == [
        (1, "given_back", "drained", None),
        (2, "stumbled", "unlucky", "surroundings_failed"),
        (3, "lost", "dead", "worker_lost"),
        (4, "done", "good", None),
    ]
    with database.reading() as session:
        for row in session.scalars(select(JobEvent)):
            assert row.started_at <= row.at


def test_work_whose_subject_was_deleted_ends_on_record(database):
    fleet_id = make_fleet(database)
    (job_id,) = make_jobs(database, fleet_id, 1)
    assert claim(database, job_id, "w")
    with database.writing() as session:
        abandon(session, [fleet_id])
    assert history(database, job_id) == [(1, "cancelled", "w", None)]


def test_a_finish_that_is_rolled_back_leaves_no_history(database):
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    with pytest.raises(ZeroDivisionError), finishing(database, claim(database, job_id, "w")):
        raise ZeroDivisionError
    assert history(database, job_id) == [] and states(database) == ["running"]


def test_jobs_carry_the_request_that_caused_them(database):
    fleet_id = make_fleet(database)
    with working_for("from-the-api"):
        (job_id,) = make_jobs(database, fleet_id, 1)
    (other,) = make_jobs(database, fleet_id, 1)
    assert claim(database, job_id, "w").request_id == "from-the-api"
    with database.reading() as session:
        assert session.get_one(Job, other).request_id is None
