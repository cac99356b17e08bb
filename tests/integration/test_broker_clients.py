"""Whoever reaches the broker can send messages: none of them ends a worker, hangs it, or stops its work."""

import base64
import json
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from subprocess import Popen
from uuid import UUID

import pytest
import redis
from celery import Celery
from sqlalchemy import select

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.db.jobs import Worker
from service.platform.db.session import Database
from service.platform.jobs.messages import Message, Sender, task_of
from service.platform.settings import Settings
from service.platform.storage.store import open_store
from tests.service.platform.jobs.support import job, make_fleet, make_jobs
from tests.support.broker import Broker
from tests.support.processes import start, stop_all, wait_until

pytestmark = pytest.mark.faults

TASK = task_of("solve")
ORDERS = (("shutdown", {}), ("pool_shrink", {"n": 1}), ("cancel_consumer", {"queue": "solve"}), ("pool_restart", {}))


@dataclass
class Workers:
    """A worker of one process and the sweeper, as `apexcal serve` starts them."""

    broker: Broker
    database: Database
    fleet_id: UUID
    environment: dict[str, str]
    children: list[Popen[bytes]]

    def still_work(self) -> None:
        """Fails unless both are the processes that they were and a job is still taken."""
        (made,) = make_jobs(self.database, self.fleet_id, 1)
        sender = Sender(self.broker.url)
        sender([Message(made, "solve")])
        sender.close()
        wait_until(lambda: job(self.database, made).attempt > 0, "an attempt at a job that was sent afterwards", 30)
        assert [child.poll() for child in self.children] == [None, None]


@pytest.fixture(scope="module")
def workers(sqlite_template: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workers]:
    """The same for all tests: what one of them sends changes nothing for the next one either."""
    root = tmp_path_factory.mktemp("workers")
    url = f"sqlite:///{shutil.copy(sqlite_template, root / 'apexcal.db')}"
    broker, database, folder, log = Broker(), Database(url), DataFolder(root / "data"), root / "log"
    open_store(Settings(data_dir=folder.root)).prepare()
    environment = {
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        **os.environ,
        "APEXCAL_DATA_DIR": str(folder.root),
        "APEXCAL_DATABASE_URL": url,
        "APEXCAL_BROKER_URL": broker.url,
        "APEXCAL_MIN_FREE_BYTES": "0",
    }
    commands = (plans.worker(folder, environment, 1), plans.sweeper(folder, environment))
    children = [start(list(one.command), log, env=environment) for one in commands]
    try:
        wait_until(lambda: is_warm(database), "a warm worker", 120)
        yield Workers(broker, database, make_fleet(database), environment, children)
    finally:
        stop_all(children)
        database.close()
        broker.close()


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


def test_orders_and_nonsense_change_nothing(workers: Workers) -> None:
    with Celery("somebody", broker=workers.broker.url, set_as_current=False) as app:
        for order, arguments in ORDERS:
            app.control.broadcast(order, arguments=arguments)
        for number in (2**70, -1, 0, "x", "1; DROP TABLE job", None, 1.5, [1], {"a": 1}, "\ud800", "\x00", True):
            app.send_task(TASK, args=(number,), queue="solve")
        app.send_task(TASK, args=(1, 2), kwargs={"three": 3}, queue="solve")
        app.send_task("os.system", args=("true",), queue="solve")
        app.send_task("apexcal.kind_of_a_newer_version", args=(1,), queue="solve")
        app.send_task(TASK, args=(1,), queue="solve", serializer="pickle")
    workers.still_work()


def test_orders_are_obeyed_where_the_operator_allows_them(workers: Workers, tmp_path: Path) -> None:
    environment = workers.environment | {"APEXCAL_CELERY_CONTROL": "true"}
    command = plans.worker_command("ingest", 1, "obedient")
    child = start(list(command), tmp_path / "log", env=environment)
    try:
        with Celery("somebody", broker=workers.broker.url, set_as_current=False) as app:

            def answers() -> set[str]:
                return {name.partition("@")[0] for name in app.control.inspect(timeout=0.5).ping() or {}}

            wait_until(lambda: answers() == {"obedient"}, "the answer of the worker that obeys, and of no other", 60)
            app.control.broadcast("shutdown")
        wait_until(lambda: child.poll() == 0, "its end", 30)
    finally:
        stop_all([child])
    workers.still_work()


def test_messages_that_are_none_change_nothing(workers: Workers) -> None:
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
    with workers.broker.client() as client:
        push(client, "solve", broken)
        push(client, "sweep", broken)
    workers.still_work()


def push(client: redis.Redis, queue: str, messages: list[str]) -> None:
    for one in messages:
        client.lpush(queue, one)
