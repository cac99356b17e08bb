"""Whoever reaches the broker can send messages: none of them ends a worker, hangs it, or stops its work."""

import base64
import json
import time
from collections.abc import Iterator

import pytest
import redis
from celery import Celery
from sqlalchemy import select

from service.platform.db.jobs import Worker
from service.platform.db.session import Database
from service.platform.jobs.messages import Message, Sender, task_of
from tests.faults.farm import Farm
from tests.service.platform.jobs.support import job, make_fleet, make_jobs
from tests.support.processes import wait_until

pytestmark = pytest.mark.faults

TASK = task_of("solve")
ORDERS = (("shutdown", {}), ("pool_shrink", {"n": 1}), ("cancel_consumer", {"queue": "solve"}), ("pool_restart", {}))


@pytest.fixture(autouse=True)
def work_goes_on(farm: Farm) -> Iterator[None]:
    """Worker and sweeper must be the processes that they were, and take a job that is sent afterwards."""
    farm.use_worker(2)
    wait_until(lambda: is_warm(farm.database), "a warm worker")
    before = farm.pid("worker"), farm.pid("sweeper")
    yield
    (made,) = make_jobs(farm.database, make_fleet(farm.database, f"fleet {before} {time.monotonic()}"), 1)
    sender = Sender(farm.broker.url)
    sender([Message(made, "solve")])
    sender.close()
    wait_until(lambda: job(farm.database, made).state == "failed", "the end of a job of nothing")
    assert (farm.is_dead("worker"), farm.is_dead("sweeper")) == (False, False)
    assert (farm.pid("worker"), farm.pid("sweeper")) == before


def is_warm(database: Database) -> bool:
    with database.reading() as session:
        return session.scalar(select(Worker.warm).where(Worker.queues != "sweep")) is True


def envelope(body: object, **changed: object) -> dict[str, object]:
    """A message as Celery sends it."""
    headers = {"id": "1", "task": TASK, "lang": "py", "argsrepr": "", "kwargsrepr": ""}
    properties = {
        "body_encoding": "base64",
        "delivery_tag": "1",
        "delivery_info": {"exchange": "", "routing_key": "x"},
    }
    text = base64.b64encode(json.dumps(body).encode()).decode()
    usual = {"content-type": "application/json", "content-encoding": "utf-8"}
    return {"body": text, "headers": headers, "properties": properties, **usual, **changed}


def test_orders_and_nonsense_change_nothing(farm: Farm) -> None:
    with Celery("somebody", broker=farm.broker.url, set_as_current=False) as app:
        for order, arguments in ORDERS:
            app.control.broadcast(order, arguments=arguments)
        for number in (2**70, -1, 0, "x", "1; DROP TABLE job", None, 1.5, [1], {"a": 1}, "\ud800", "\x00", True):
            app.send_task(TASK, args=(number,), queue="solve")
        app.send_task(TASK, args=(1, 2), kwargs={"three": 3}, queue="solve")
        app.send_task("os.system", args=("true",), queue="solve")
        app.send_task("apexcal.kind_of_a_newer_version", args=(1,), queue="solve")
        app.send_task(TASK, args=(1,), queue="solve", serializer="pickle")


def test_orders_are_obeyed_where_the_operator_allows_them(farm: Farm) -> None:
    farm.start_beside("obedient", {"APEXCAL_CELERY_CONTROL": "true"}, "ingest")
    try:
        with Celery("somebody", broker=farm.broker.url, set_as_current=False) as app:

            def answers() -> set[str]:
                return {name.partition("@")[0] for name in app.control.inspect(timeout=0.5).ping() or {}}

            wait_until(lambda: answers() == {"obedient"}, "the answer of the worker that obeys, and of no other")
            app.control.broadcast("shutdown")
        wait_until(lambda: farm.is_dead("obedient"), "its end")
    finally:
        codes = farm.stop("obedient")
    assert codes == {"obedient": 0}


def test_messages_that_are_none_change_nothing(farm: Farm) -> None:
    fitting = envelope([[1], {}, {}])
    broken = [
        *("no json", "", "[]", "{}", "1", "null", '{"a": ', "\x00\xff"),
        json.dumps({**fitting, "body": "no base64 \x00"}),
        json.dumps({**fitting, "headers": None}),
        json.dumps({**fitting, "properties": {}}),
        json.dumps({**fitting, "content-type": "application/x-python-serialize"}),
        json.dumps({**fitting, "content-encoding": "none such"}),
        json.dumps({**fitting, "headers": {"id": [], "task": {}}}),
        json.dumps({**fitting, "headers": {"id": "1", "task": TASK, "timelimit": 7, "eta": {}, "expires": []}}),
        json.dumps(envelope("no triple")),
        "[" * 100_000,
        json.dumps(envelope([[1], {}, {"callbacks": 7, "chain": "x"}])),
    ]
    with farm.broker.client() as client:
        push(client, "solve", broken)
        push(client, "sweep", broken)


def push(client: redis.Redis, queue: str, messages: list[str]) -> None:
    for one in messages:
        client.lpush(queue, one)
