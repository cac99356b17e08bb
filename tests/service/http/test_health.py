"""What the service says of itself."""

import json

from service.db import migrate
from service.db.clock import now
from service.db.jobs import Heartbeat, Worker
from tests.support.broker import Broker
from tests.support.people import Api


def beat(api: Api, ago_s: float = 0.0) -> None:
    with api.database.writing() as session:
        session.merge(Heartbeat(name="sweep", at=now(-ago_s)))


def test_ready_only_while_every_part_works(api: Api, broker: Broker) -> None:
    assert api.client.get("/healthz").json() == {"status": "ok"}
    answer = api.client.get("/readyz")
    assert answer.status_code == 503 and answer.json()["parts"]["sweep"]["ok"] is False
    beat(api)
    answer = api.client.get("/readyz")
    assert answer.status_code == 200, answer.text
    assert set(answer.json()["parts"]) == {"database", "broker", "store", "sweep", "workers"}
    beat(api, ago_s=3600)
    assert api.client.get("/readyz").json()["parts"]["sweep"]["ok"] is False
    beat(api)
    broker.stop()
    answer = api.client.get("/readyz")
    assert answer.status_code == 503 and answer.json()["parts"]["broker"]["ok"] is False
    assert api.client.get("/healthz").status_code == 200


def test_too_little_disk_is_not_ready(make_api) -> None:
    api = make_api(min_free_bytes=2**62)
    beat(api)
    store = api.client.get("/readyz").json()["parts"]["store"]
    assert store["ok"] is False and "bytes are free" in store["detail"]


def test_the_supervisors_children_are_shown(make_api, tmp_path) -> None:
    status = tmp_path / "supervisor.json"
    api = make_api(supervisor_status=status)
    beat(api)
    assert api.client.get("/readyz").json()["parts"]["children"]["ok"] is False
    for state, code in (("running", 200), ("restarting", 503)):
        child = {"name": "beat", "pid": 1, "state": state, "restarts": 0, "since": "2026-01-01T00:00:00Z"}
        status.write_text(json.dumps({"children": [child]}))
        answer = api.client.get("/readyz")
        assert answer.status_code == code and answer.json()["parts"]["children"]["children"] == [child]


def test_an_older_schema_is_not_ready_and_a_newer_one_is(api: Api, monkeypatch) -> None:
    """A newer one is there while an upgrade rolls: what this version needs is still in it."""
    beat(api)
    present = migrate.newest()
    monkeypatch.setattr(migrate, "revisions", lambda: ("9999", present))
    answer = api.client.get("/readyz")
    assert answer.status_code == 503
    assert "python -m service.db.migrate" in answer.json()["parts"]["database"]["detail"]
    monkeypatch.setattr(migrate, "revisions", lambda: ("0001",))
    answer = api.client.get("/readyz")
    assert answer.status_code == 200 and "newer" in answer.json()["parts"]["database"]["detail"]


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
    assert workers()["status"] == "ok"
    assert [worker["name"] for worker in workers()["parts"]["workers"]["workers"]] == ["new"]
