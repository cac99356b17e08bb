"""`/metrics` as Prometheus reads it: what happened is in it, totals only grow, and it is not open to everybody."""

from __future__ import annotations

from typing import Any

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families
from pydantic import SecretStr
from sqlalchemy import delete, event, select, update
from sqlalchemy.exc import OperationalError

from service.platform.db.calibrations import CalibrationRun, Slot
from service.platform.db.clock import now
from service.platform.db.jobs import Heartbeat, Job, Worker
from service.platform.db.recordings import Blob
from service.platform.jobs.claims import claim, finishing, requeue_after_failure
from service.platform.jobs.history import tally
from service.platform.jobs.reaper import reap
from service.platform.jobs.retention import forget_jobs
from tests.service.platform.jobs.support import let_backoff_end, make_calibration, make_fleet, make_jobs
from tests.support.leases import let_lease_expire
from tests.support.people import Api
from tests.support.rows import add

TOKEN = {"Authorization": "Bearer scrape-me"}


@pytest.fixture
def scraped(make_api) -> Api:
    return make_api(metrics_token=SecretStr("scrape-me"))


def read(api: Api, monkeypatch=None) -> dict[str, dict[tuple, float]]:
    """Every sample by name and sorted labels."""
    answer = api.client.get("/metrics", headers=TOKEN)
    assert answer.status_code == 200, answer.text
    found: dict[str, dict[tuple, float]] = {}
    for family in text_string_to_metric_families(answer.text):
        assert family.documentation, family.name
        for sample in family.samples:
            found.setdefault(sample.name, {})[tuple(sorted(sample.labels.items()))] = sample.value
    return found


@pytest.fixture
def always_fresh(monkeypatch) -> None:
    monkeypatch.setattr("service.platform.health.database_figures.FRESH_S", 0.0)
    monkeypatch.setattr("service.platform.health.database_figures._BLOBS_FRESH_S", 0.0)


def settle(api: Api) -> None:
    with api.database.writing() as session:
        tally(session)


def test_what_happened_to_jobs_is_counted(scraped: Api, always_fresh) -> None:
    database = scraped.database
    _, (run_id,) = make_calibration(database)
    first, second, waits = make_jobs(database, make_fleet(database, "other"), 3, run_id)
    held = claim(database, first, "w")
    assert held
    requeue_after_failure(database, held, {"code": "surroundings_failed"}, 0.0)
    assert claim(database, second, "w")
    let_backoff_end(database)
    with finishing(database, claim(database, first, "w")):  # pyright: ignore[reportArgumentType]
        pass
    let_lease_expire(database, second)
    reap(database, scraped.app.state.store)
    settle(scraped)
    with database.writing() as session:
        # Sent 95 s ago and three times since, after 10, 20 and 40 s. Of the others one is behind the window.
        session.execute(update(Job).where(Job.id == waits).values(sends=4, send_after=now(150 - 95)))
        session.execute(update(Job).where(Job.id == second).values(sends=0, send_after=None))
        session.add(Blob(key="a", state="stored", size=70))
        session.add(Blob(key="b", state="stored", size=7))
        session.add(Worker(name="w", queues="solve", processes=3, version="1", warm=True, started_at=now(), at=now()))
        session.merge(Heartbeat(name="sweep", at=now(-4)))
    found = read(scraped)
    assert found["apexcal_jobs"] == {(("kind", "solve"), ("state", "queued")): 2}
    assert found["apexcal_queue_depth"][(("queue", "solve"),)] == 1
    assert 90 <= found["apexcal_queue_oldest_seconds"][(("queue", "solve"),)] < 900
    events = found["apexcal_job_events_total"]
    assert {dict(labels)["what"]: count for labels, count in events.items()} == {"done": 1, "stumbled": 1, "lost": 1}
    assert found["apexcal_job_seconds_count"][(("kind", "solve"),)] == 1
    assert found["apexcal_job_seconds_bucket"][(("kind", "solve"), ("le", "+Inf"))] == 1
    assert found["apexcal_blob_bytes"][(("state", "stored"),)] == 77
    assert found["apexcal_worker_processes"][(("queue", "solve"),)] == 3
    assert found["apexcal_workers"][(("warm", "true"),)] == 1
    assert 4 <= found["apexcal_heartbeat_age_seconds"][(("name", "sweep"),)] < 900
    assert found["apexcal_database_up"][()] == 1


def test_totals_do_not_shrink_when_the_jobs_are_gone(scraped: Api, always_fresh) -> None:
    database = scraped.database
    _, (run_id,) = make_calibration(database)
    (job_id,) = make_jobs(database, make_fleet(database, "other"), 1, run_id)
    with finishing(database, claim(database, job_id, "w")):  # pyright: ignore[reportArgumentType]
        pass
    with database.writing() as session:
        session.execute(update(Job).values(finished_at=now(-400 * 86400)))
        add(session, Slot, run_id=run_id)
        session.execute(update(CalibrationRun).values(state="done"))
    assert forget_jobs(database) == 0, "not before it is counted"
    settle(scraped)
    settle(scraped)
    before = read(scraped)["apexcal_job_events_total"]
    assert forget_jobs(database) == 1
    with database.reading() as session:
        assert session.scalars(select(Slot.loss)).all() == [], "slots go with the jobs that found them"
    assert read(scraped)["apexcal_job_events_total"] == before == {(("kind", "solve"), ("what", "done")): 1}


def test_requests_are_counted_by_route_never_by_address(scraped: Api) -> None:
    owner = scraped.owner()
    for number in range(3):
        owner.get(f"/jobs/{number + 12345}")
        scraped.client.get(f"/no/such/{number}", headers={"Accept": "text/html"})
    scraped.client.request("BREW", "/healthz")
    found = read(scraped)["apexcal_http_requests_total"]
    by_route: dict[tuple[str, str, str], float] = {
        tuple(dict(labels)[name] for name in ("method", "route", "status")): count for labels, count in found.items()
    }
    assert by_route[("GET", "/v1/jobs/{id}", "404")] == 3
    assert by_route[("GET", "pages", "200")] == 3
    assert not any("12345" in route or "such" in route for _, route, _ in by_route)
    assert {method for method, _, _ in by_route} == {"GET", "other"}


def test_asking_often_costs_the_database_nothing(scraped: Api) -> None:
    read(scraped)
    said: list[str] = []

    def listen(*args: Any) -> None:
        said.append(args[2])

    event.listen(scraped.database.engine, "before_cursor_execute", listen)
    for _ in range(5):
        read(scraped)
    assert said == []


def test_a_database_that_is_away_is_said_not_hidden(scraped: Api, always_fresh, monkeypatch) -> None:
    assert scraped.client.get("/healthz").status_code == 200
    with scraped.database.writing() as session:
        session.execute(delete(Heartbeat))
    monkeypatch.setattr("service.platform.health.database_figures._queues", _broken)
    found = read(scraped)
    assert found["apexcal_database_up"][()] == 0
    assert "apexcal_jobs" not in found and "apexcal_http_requests_total" in found


def _broken(session: Any) -> Any:
    raise OperationalError("SELECT", {}, Exception("gone"))


def test_who_may_read_them(make_api, served) -> None:
    guarded = make_api(metrics_token=SecretStr("scrape-me")).client
    for headers in ({}, {"Authorization": "Bearer wrong"}, {"Authorization": "Basic scrape-me"}):
        answer = guarded.get("/metrics", headers=headers)
        assert answer.status_code == 401 and answer.json()["code"] == "metrics_token_wrong"
    _, url = served
    assert httpx.get(f"{url}/metrics").status_code == 200, "the same host may, where no token is set"
    for added in ({"X-Forwarded-For": "203.0.113.9"}, {"X-Forwarded-Proto": "https"}, {"Host": "cal.example.org"}):
        through_a_proxy = httpx.get(f"{url}/metrics", headers=added)
        assert through_a_proxy.status_code == 403 and through_a_proxy.json()["code"] == "metrics_closed", added
