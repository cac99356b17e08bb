"""What becomes of a job whose work raises."""

from __future__ import annotations

import pytest

from tests.service.jobs.support import job, make_fleet, make_jobs
from workers.readers.recording import ReadError
from workers.tasks.running import WORK, run_job


@pytest.mark.parametrize(
    ("code", "state", "lost"),
    [("ingest_disk_full", "queued", 1), ("ingest_killed", "queued", 1), ("no_such_topic", "failed", 0)],
)
def test_a_reader_that_was_killed_or_had_no_disk_is_tried_again_and_a_refusal_is_not(
    context, database, monkeypatch, code, state, lost
):
    def refuse(*_: object) -> None:
        raise ReadError(code, "It could not be read.", "Look at it.")

    monkeypatch.setitem(WORK, "solve", refuse)
    (job_id,) = make_jobs(database, make_fleet(database), 1)
    run_job(context, job_id)
    assert (job(database, job_id).state, job(database, job_id).lost) == (state, lost)
