"""What becomes of a job whose work raises."""

from __future__ import annotations

import errno

import pytest
from sqlalchemy import select

from service.platform.db.clock import now
from service.platform.db.jobs import Job
from service.platform.storage.errors import StoreFullError
from tests.service.platform.jobs.support import job, let_backoff_end, make_fleet, make_jobs
from workers.readers.recording import ReadError
from workers.tasks.running import WORK, run_job


@pytest.fixture
def job_that_raises(database, monkeypatch):
    """The id of a job whose work raises these errors, one after the other; the last one again and again."""

    def make(*errors):
        left = list(errors)

        def work(*_: object) -> None:
            raise left.pop(0) if len(left) > 1 else left[0]

        monkeypatch.setitem(WORK, "solve", work)
        return make_jobs(database, make_fleet(database), 1)[0]

    return make


@pytest.mark.parametrize(
    ("code", "state", "lost"),
    [("ingest_disk_full", "queued", 1), ("ingest_killed", "queued", 1), ("no_such_topic", "failed", 0)],
)
def test_a_reader_that_was_killed_or_had_no_disk_is_tried_again_and_a_refusal_is_not(
    context, database, job_that_raises, code, state, lost
):
    job_id = job_that_raises(ReadError(code, "It could not be read.", "Look at it."))
    run_job(context, job_id)
    assert (job(database, job_id).state, job(database, job_id).lost) == (state, lost)


def test_a_number_that_is_none_refuses_and_is_no_defect(context, database, monkeypatch):
    """Whatever computes it, and wherever in a document it is."""
    (job_id,) = make_jobs(database, make_fleet(database), 1)

    def compute(*_: object):
        def write(session):
            session.get_one(Job, job_id).payload = {"halves": [{"ratio": 1.0}, {"ratio": float("nan")}]}

        return write

    monkeypatch.setitem(WORK, "solve", compute)
    run_job(context, job_id)
    ended = job(database, job_id)
    assert (ended.state, ended.problem["code"]) == ("failed", "non_finite")
    assert ended.problem["detail"].startswith("halves.1.ratio of the result is not finite")


def problem_of(database, job_id):
    return (job(database, job_id).problem or {}).get("code")


@pytest.mark.parametrize(
    "error",
    [ReadError("ingest_disk_full", "The disk was full.", "Make room."), OSError(errno.ENOSPC, "x"), StoreFullError()],
)
def test_what_had_no_room_is_tried_four_times_and_then_says_what_to_do(context, database, job_that_raises, error):
    job_id = job_that_raises(error)
    waits = []
    for _ in range(4):
        assert job(database, job_id).state == "queued"
        run_job(context, job_id)
        with database.reading() as session:
            waits.append(session.execute(select(Job.send_after, now()).where(Job.id == job_id)).one())
        let_backoff_end(database)
    for (after, at), stated_s in zip(waits, (2, 8, 32), strict=False):
        assert stated_s - 2 < (after - at).total_seconds() <= stated_s  # the clock went on between both readings
    ended = job(database, job_id)
    assert (ended.state, problem_of(database, job_id)) == ("failed", "ingest_disk_full")
    assert "Nothing is wrong with your data" in ended.problem["hint"]


def test_other_stumbles_do_not_count_against_the_tries_without_room(context, database, job_that_raises):
    errors = [OSError(errno.EIO, "x")] * 5 + [OSError(errno.ENOSPC, "x")] * 3
    job_id = job_that_raises(*errors)
    for _ in errors:
        run_job(context, job_id)
        let_backoff_end(database)
    assert job(database, job_id).state == "queued"


@pytest.mark.parametrize("number", [errno.ENAMETOOLONG, errno.EFBIG, errno.E2BIG])
def test_what_only_the_input_can_cause_is_not_tried_for_an_hour(context, database, job_that_raises, number):
    job_id = job_that_raises(OSError(number, "x"))
    run_job(context, job_id)
    assert (job(database, job_id).state, problem_of(database, job_id)) == ("failed", "internal_error")
