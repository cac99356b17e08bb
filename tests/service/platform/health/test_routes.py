"""What the service says of itself."""

import errno
import json
import signal
import threading
from collections import Counter, defaultdict
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any
from unittest.mock import patch

import pytest
from anyio.to_thread import current_default_thread_limiter
from pydantic import SecretStr
from sqlalchemy import event

from service.platform.db import revisions
from service.platform.db.clock import now
from service.platform.db.fleets import Rig
from service.platform.db.jobs import Heartbeat, Worker
from service.platform.db.session import Database
from service.platform.health import parts as health_parts
from service.platform.storage.store import Store
from tests.service.publications.given import camera_address, publish
from tests.support.broker import Broker
from tests.support.people import Actor, Api
from tests.support.processes import wait_until

# For all requests that are no streams; Starlette has 40.
THREADS = 3


@pytest.fixture
def always_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every question makes the service look again at what does not work, and at most of what does."""
    monkeypatch.setattr(health_parts, "AGAIN_S", 0.0)
    monkeypatch.setattr(health_parts.Part.__init__, "__defaults__", (0.0,))


def beat(api: Api, ago_s: float = 0.0) -> None:
    with api.database.writing() as session:
        session.merge(Heartbeat(name="sweep", at=now(-ago_s)))


@dataclass(frozen=True)
class Car:
    """A program on a vehicle with a published calibration, which any process of the service answers."""

    viewer: Actor
    address: str
    result: str

    def degraded(self, api: Api) -> dict[str, str]:
        """The parts that are ill, and why, of a process that is ready all the same and answers this car."""
        answer = api.client.get("/readyz")
        assert answer.status_code == 200, answer.text
        calibration = replace(self.viewer, client=api.client).get(self.address)
        assert (calibration.status_code, calibration.json()["result_id"]) == (200, self.result)
        return dict(one.split(": ", 1) for one in answer.json()["degraded"])


@pytest.fixture
def car(api: Api, rig: Rig, viewer: Actor, reviewer: Actor) -> Car:
    made = publish(api, rig, reviewer)
    return Car(viewer, f"{camera_address(rig)}/calibration", made["result_id"])


@pytest.mark.usefixtures("always_anew")
def test_what_every_process_shares_makes_none_unready(make_api, broker: Broker, car: Car) -> None:
    api = make_api(metrics_token=SecretStr("scrape-me"))
    assert api.client.get("/healthz").json() == {"status": "ok"}
    assert car.degraded(api)["sweep"].startswith("the sweep has never run")
    beat(api)
    assert set(car.degraded(api)) == {"workers"}
    assert set(api.client.get("/readyz").json()["parts"]) == {
        "database",
        "writes",
        "broker",
        "store",
        "sweep",
        "workers",
    }
    beat(api, ago_s=3600)
    assert "late" in car.degraded(api)["sweep"]
    beat(api)
    broker.child.send_signal(signal.SIGSTOP)
    try:
        assert set(car.degraded(api)) == {"broker", "workers"}
    finally:
        broker.child.send_signal(signal.SIGCONT)
    wait_until(lambda: set(car.degraded(api)) == {"workers"}, "a broker that answers again")
    broker.stop()
    assert set(car.degraded(api)) == {"broker", "workers"}
    assert (
        'apexcal_part_up{part="broker"} 0.0'
        in api.client.get("/metrics", headers={"authorization": "Bearer scrape-me"}).text
    )
    assert api.client.get("/healthz").status_code == 200


@pytest.mark.usefixtures("always_anew")
def test_a_store_that_is_away_or_full_makes_no_process_unready(make_api, tmp_path, car: Car) -> None:
    api = make_api(min_free_bytes=2**62)
    assert "too little room" in car.degraded(api)["store"]
    with patch.object(Store, "put_bytes", side_effect=OSError(errno.ENOSPC, "no space")):
        assert "store" in car.degraded(make_api())


@pytest.mark.usefixtures("always_anew")
def test_a_database_that_takes_no_writes_is_ready_and_says_so(api: Api, car: Car) -> None:
    """As a full one, one that only reads: a vehicle is answered."""
    beat(api)
    health: Database = api.app.state.health_databases[1]
    refused = ["OFF", "ON"]

    def checkout(connection: Any, *_: object) -> None:
        if health.engine.dialect.name == "sqlite":
            connection.execute(f"PRAGMA query_only={refused[-1]}")
        else:
            connection.read_only = refused[-1] == "ON"

    event.listen(health.engine, "checkout", checkout)
    assert "takes no writes" in car.degraded(api)["writes"]
    refused.pop()
    assert "writes" not in car.degraded(api)


@pytest.mark.usefixtures("always_anew")
def test_the_supervisors_children_are_shown(make_api, tmp_path, car: Car) -> None:
    status = tmp_path / "supervisor.json"
    api = make_api(supervisor_status=status)
    beat(api)
    assert "children" in car.degraded(api)
    for state, ill in (("running", set()), ("restarting", {"children"})):
        child = {"name": "sweeper", "pid": 1, "state": state, "restarts": 0, "since": "2026-01-01T00:00:00Z"}
        status.write_text(json.dumps({"children": [child]}))
        assert set(car.degraded(api)) - {"workers"} == ill
        assert api.client.get("/readyz").json()["parts"]["children"]["children"] == {"sweeper": state}


@pytest.mark.usefixtures("always_anew")
def test_an_older_schema_is_not_ready_and_a_newer_one_is(api: Api, monkeypatch) -> None:
    """A newer one is there while an upgrade rolls: what this version needs is still in it."""
    beat(api)
    present = revisions.newest()
    monkeypatch.setattr(revisions, "all_revisions", lambda: ("9999", present))
    answer = api.client.get("/readyz")
    assert answer.status_code == 503
    assert "python -m service.platform.db.migrate" in answer.json()["parts"]["database"]["detail"]
    monkeypatch.setattr(revisions, "all_revisions", lambda: ("0000",))
    answer = api.client.get("/readyz")
    assert answer.status_code == 200 and "newer" in answer.json()["parts"]["database"]["detail"]


@pytest.mark.usefixtures("always_anew")
def test_it_says_which_workers_answer_and_which_still_compile(api: Api) -> None:
    beat(api)

    def workers() -> dict:
        return api.client.get("/readyz").json()

    assert workers()["status"] == "degraded" and workers()["parts"]["workers"]["detail"] == "no worker answers"
    row = {"queues": "solve", "processes": 2, "version": "1", "started_at": now(-60)}
    with api.database.writing() as session:
        session.add(Worker(name="gone", warm=True, at=now(-30), **row))
        session.add(Worker(name="new", warm=False, at=now(), **row))
    assert workers()["status"] == "degraded" and "compiling" in workers()["parts"]["workers"]["detail"]
    with api.database.writing() as session:
        session.get_one(Worker, "new").warm = True
    assert workers()["status"] == "degraded" and "ingest, detect, report" in workers()["parts"]["workers"]["detail"]
    with api.database.writing() as session:
        session.get_one(Worker, "new").queues = "detect,ingest,report,solve"
    assert workers()["status"] == "ok"
    found = workers()["parts"]["workers"]
    assert (found["answering"], found["warm"]) == (1, 1) and "new" not in str(found)


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_it_answers_in_time_and_keeps_to_itself_why_a_part_hangs_or_fails(make_api, monkeypatch, caplog) -> None:
    """Whatever hangs, also every thread that serves requests; and however often it is asked, it looks once."""
    monkeypatch.setattr(health_parts, "PATIENCE_S", 0.5)
    api = make_api(broker_url="redis://:hidden@127.0.0.1:1/0")
    api.client.portal.call(lambda: setattr(current_default_thread_limiter(), "total_tokens", THREADS))
    viewer = api.member(api.fleet(), "viewer")
    ended, hanging = threading.Event(), threading.Semaphore(0)
    written: Counter[str] = Counter()
    waited: dict[str, list[float]] = defaultdict(list)
    patience, put_bytes = health_parts.Part.patience, Store.put_bytes

    def hang() -> Any:
        hanging.release()
        ended.wait()
        return Database.reading(api.database)

    def put(*arguments: Any) -> Any:
        written.update(["store"])
        ended.wait()
        return put_bytes(*arguments)

    def noted(part: health_parts.Part) -> float:
        waited[part.name].append(patience(part))
        return waited[part.name][-1]

    monkeypatch.setattr(Store, "put_bytes", put)
    monkeypatch.setattr(health_parts.Part, "patience", noted)
    monkeypatch.setattr(api.database, "reading", hang)
    for database in api.app.state.health_databases:
        monkeypatch.setattr(database, "reading", hang)
    requests = [threading.Thread(target=viewer.get, args=("/fleets",)) for _ in range(THREADS + 1)]
    try:
        for request in requests:
            request.start()
        for _ in range(THREADS):
            assert hanging.acquire(timeout=60)
        answers = [api.client.get("/readyz") for _ in range(20)]
        assert api.client.get("/healthz").status_code == 200
    finally:
        ended.set()
        for request in requests:
            request.join()
    assert {answer.status_code for answer in answers} == {503} and written == {"store": 1}
    parts: dict[str, Any] = answers[-1].json()["parts"]
    for name in ("store", "database", "sweep"):
        assert len(waited[name]) == 20 and sum(waited[name]) < 2.0 * health_parts.PATIENCE_S
        assert parts[name] == {"ok": False, "detail": "no answer within 0.5 s"}
    for word in ("Error", "127.0.0.1", "refused", "hidden"):
        assert word not in answers[-1].text
    said = [one.getMessage() for one in caplog.records if "readiness: broker: " in one.getMessage()]
    assert any("ConnectionError" in one for one in said), "and a line when it changes, not at every look:"
    assert all(before != after for before, after in pairwise(said))
