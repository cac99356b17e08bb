"""What Celery's own programs see of the work: each job by its kind's name, in its queue, and how it ended."""

from __future__ import annotations

import re
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from celery import Celery
from sqlalchemy import select

from apexcal.client import Client, FailedError
from service.platform.db.models import Job
from service.platform.db.session import Database
from tests.faults.jobs import ask
from tests.support.processes import wait_until
from tests.support.served import Embedded

QUICK = {"slots": 2, "population": 300, "generations": 20, "max_iterations": 3}


@contextmanager
def celery_events(broker_url: str) -> Iterator[list[dict[str, Any]]]:
    """Every event that Celery tells in the block, as it is received by Flower or an exporter."""
    events: list[dict[str, Any]] = []
    ended, receives = threading.Event(), threading.Event()

    def receive(app: Celery) -> None:
        with app.connection() as origin:
            receiver = app.events.Receiver(origin, handlers={"*": events.append})
            with receiver.consumer_context() as (connection, *_):
                receives.set()
                while not ended.is_set():
                    try:
                        connection.drain_events(timeout=0.2)
                    except TimeoutError:
                        continue

    with Celery("observer", broker=broker_url, set_as_current=False) as app:
        thread = threading.Thread(target=receive, args=(app,))
        thread.start()
        try:
            assert receives.wait(120)
            yield events
        finally:
            ended.set()
            thread.join(10)


def jobs_of(embedded: Embedded, after: int) -> dict[int, tuple[str, str, str]]:
    """Kind, queue and state of each job that came after that one."""
    database = Database(f"sqlite:///{embedded.data / 'apexcal.db'}")
    try:
        with database.reading() as session:
            rows = session.scalars(select(Job).where(Job.id > after)).all()
            return {job.id: (job.kind, job.queue, job.state) for job in rows}
    finally:
        database.close()


def test_each_job_of_a_calibration_is_told_by_its_kind(embedded: Embedded, owner: Client, tmp_path: Path) -> None:
    before = max(jobs_of(embedded, 0), default=0)
    rubbish = tmp_path / "rubbish.bag"
    rubbish.write_bytes(b"no recording" * 100)
    with celery_events(f"redis+socket://{embedded.data / 'broker.sock'}?virtual_host=0") as events:
        owner.wait(ask(owner, f"of pairs {time.monotonic_ns()}", schedule=QUICK))
        try:
            vehicle = owner.vehicles.create(owner.fleets.create(f"rubbish {time.monotonic_ns()}").id, "car")
            owner.wait(owner.recordings.upload(rubbish, vehicle.id))
        except FailedError as error:
            problem = error.code
        jobs = {}

        def all_ended() -> bool:
            jobs.update(jobs_of(embedded, before))
            ends = [event for event in events if event["type"] in ("task-succeeded", "task-failed")]
            beats = {event["hostname"].partition("@")[0] for event in events if event["type"] == "worker-heartbeat"}
            if not beats >= {"worker", "worker-ingest"}:
                return False
            return len(ends) >= len(jobs) and {state for *_, state in jobs.values()} <= {"done", "failed"}

        wait_until(all_ended, "the end of each job and the beat of each worker in Celery's events")

    sent = {event["uuid"]: event for event in events if event["type"] == "task-sent"}
    received = {event["uuid"]: event for event in events if event["type"] == "task-received"}
    ends = {event["uuid"]: event for event in events if event["type"] in ("task-succeeded", "task-failed")}
    assert received.keys() == sent.keys() == ends.keys()
    events_of: dict[int, list[str]] = defaultdict(list)
    for uuid, event in received.items():
        (job_id,) = map(int, re.findall(r"\d+", event["args"]))
        kind, queue, state = jobs[job_id]
        assert (event["name"], sent[uuid]["name"]) == (f"apexcal.{kind}",) * 2
        assert (sent[uuid]["queue"], sent[uuid]["routing_key"]) == (queue, queue)
        events_of[job_id].append(ends[uuid]["type"])
        if state == "failed":
            assert problem in ends[uuid]["exception"]
    assert events_of.keys() == jobs.keys()
    for job_id, (kind, _, state) in jobs.items():
        assert ("task-failed" in events_of[job_id]) == (state == "failed"), (kind, state)
    kinds = {kind for kind, *_ in jobs.values()}
    assert kinds >= {"ingest", "solve"}
