"""What a worker has computed survives a last transaction that the database ends: the transaction is done again."""

from __future__ import annotations

import threading
import time

import pytest
from sqlalchemy import event, select, text, update

from service.platform.db.jobs import Job, JobEvent
from service.platform.db.models import Recording
from service.platform.db.session import Database
from tests.service.detections.seeding import seed_rig
from tests.service.platform.jobs.support import make_fleet
from tests.support.databases import waits_for_a_lock
from tests.support.processes import wait_until
from tests.workers.readers.making_recordings import clouds, images, interleaved, png, write_bag
from tests.workers.tasks.test_ingesting import uploaded
from workers.tasks.running import run_job


@pytest.fixture
def recording(context, database, tmp_path):
    """A recording that waits for being read, as its row and its file."""
    bag = write_bag(
        tmp_path / "one.bag", interleaved(list(clouds(3)), list(images(3, "/cam/compressed", png(640, 480))))
    )
    return uploaded(context, seed_rig(database, make_fleet(database)), bag)


def is_being_read(database: Database, recording) -> bool:
    with database.reading() as session:
        return session.get_one(Recording, recording.id).state == "ingesting"


def outcome(database: Database, recording):
    with database.reading() as session:
        row, job = session.get_one(Recording, recording.id), session.get_one(Job, recording.job_id)
        events = session.scalars(select(JobEvent.what).where(JobEvent.job_id == job.id)).all()
        return row.state, job.state, job.attempt, job.lost, events


DONE_AT_ONCE = ("ready", "done", 1, 0, ["done"])


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_deadlock_at_the_last_commit_does_not_repeat_the_work(context, database, recording, caplog):
    worker = threading.Thread(target=run_job, args=(context, recording.job_id))
    worker.start()
    wait_until(lambda: is_being_read(database, recording), "the reading")
    with database.writing() as session:
        # The server looks for a ring a second after a wait began, and ends who looks: that is the worker.
        session.execute(text("SET LOCAL deadlock_timeout = '1min'"))
        session.execute(select(Recording).where(Recording.id == recording.id).with_for_update())
        wait_until(lambda: waits_for_a_lock(database), "the worker's wait for the recording")
        session.execute(update(Job).where(Job.id == recording.job_id).values(request_id="the other"))
    worker.join(60)
    assert "deadlock detected" in caplog.text and "is done again" in caplog.text
    assert outcome(database, recording) == DONE_AT_ONCE


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_lock_that_is_not_to_be_had_at_the_last_commit_does_not_repeat_the_work(
    context, database, recording, caplog
):
    @event.listens_for(context.database.engine, "checkout")
    def be_impatient(connection, *_: object) -> None:
        connection.execute("PRAGMA busy_timeout=50")

    worker = threading.Thread(target=run_job, args=(context, recording.job_id))
    worker.start()
    wait_until(lambda: is_being_read(database, recording), "the reading")
    held = time.monotonic() + 60
    with database.writing() as session:
        session.execute(update(Job).where(Job.id == recording.job_id).values(request_id="the other"))
        while "is done again" not in caplog.text and time.monotonic() < held:
            time.sleep(0.02)
    worker.join(60)
    assert "is done again: database is locked" in caplog.text
    assert outcome(database, recording) == DONE_AT_ONCE
