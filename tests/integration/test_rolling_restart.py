"""Every API process and every worker is replaced under load: no request fails, nothing is lost, the logs tell it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from uuid import UUID

import httpx
import pytest
from sqlalchemy import func, select

from service.platform.db.models import Job, JobEvent, Vehicle
from service.platform.db.session import Database
from tests.contract.test_work import pairs_of_a_pinhole
from tests.integration.fleet import APIS, WORKERS, ComposeFleet
from tests.support.processes import wait_until
from tests.support.uploads import RIG

pytestmark = pytest.mark.faults
DRAIN_S = 2.0

# Slots of some tens of milliseconds, so that a worker is always in the middle of one.
SCHEDULE = {"population": 400, "generations": 60, "max_iterations": 8, "slots": 4}
# A worker whose kernels changed compiles them first: half a minute of an idle machine.
_COMPILING_S = 600
REQUEST = "rolling-restart-17"


@pytest.fixture
def database(fleet: ComposeFleet) -> Iterator[Database]:
    opened = Database(fleet.database_url)
    yield opened
    opened.close()


@pytest.fixture
def owner(fleet: ComposeFleet) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"{fleet.url}/v1", headers=_signed(fleet.token), timeout=30) as client:
        yield client


class Hammer(threading.Thread):
    """A client that keeps its connection, reads and writes a few times a second, and forgives nothing."""

    def __init__(self, fleet: ComposeFleet, fleet_id: str, name: str) -> None:
        super().__init__(daemon=True)
        self.made: list[str] = []
        self.asked = 0
        self.failures: list[str] = []
        self.enough = threading.Event()
        self._url, self._token, self._fleet_id, self._name = fleet.url, fleet.token, fleet_id, name

    def run(self) -> None:
        with httpx.Client(base_url=f"{self._url}/v1", headers=_signed(self._token), timeout=30) as client:
            while not self.enough.is_set():
                self._ask(client)
                # More would only take the processors from the processes that start.
                time.sleep(0.25)

    def _ask(self, client: httpx.Client) -> None:
        name = f"{self._name} {self.asked}"
        try:
            made = client.post(f"/fleets/{self._fleet_id}/vehicles", json={"name": name})
            read = client.get(f"/fleets/{self._fleet_id}")
        except httpx.HTTPError as error:
            self.failures.append(f"{self.asked}: {type(error).__name__} {error}")
            return
        self.asked += 2
        if (made.status_code, read.status_code) != (201, 200):
            self.failures.append(f"{made.status_code} {made.text} {read.status_code} {read.text}")
        self.made.append(name)


class Follower(threading.Thread):
    """A page that follows the fleet's events, and connects anew whenever its stream ends."""

    def __init__(self, fleet: ComposeFleet, fleet_id: str) -> None:
        super().__init__(daemon=True)
        self.streams = 0
        self.failures: list[str] = []
        self.enough = threading.Event()
        self._address, self._token = f"{fleet.url}/v1/fleets/{fleet_id}/events", fleet.token

    def run(self) -> None:
        while not self.enough.is_set():
            try:
                with httpx.stream("GET", self._address, headers=_signed(self._token), timeout=60) as stream:
                    self.streams += 1
                    for _ in stream.iter_lines():
                        if self.enough.is_set():
                            return
            except httpx.HTTPError as error:
                self.failures.append(f"{type(error).__name__} {error}")
                return


def _signed(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def _prepare(client: httpx.Client) -> tuple[str, str, str]:
    """A fleet, a vehicle and pairs to calibrate with."""
    fleet_id = client.post("/fleets", json={"name": "north"}).json()["id"]
    vehicle = client.post(f"/fleets/{fleet_id}/vehicles", json={"name": "van"}).json()["id"]
    rig = client.post(f"/vehicles/{vehicle}/rigs", json=RIG).json()["id"]
    body = {"pairs": pairs_of_a_pinhole()}
    made = client.post(f"/rigs/{rig}/correspondence-sets", json=body, params={"camera": "front"})
    assert made.status_code == 201, made.text
    return fleet_id, vehicle, made.json()["id"]


def _calibrate(client: httpx.Client, vehicle: str, pairs: str, request_id: str) -> str:
    body = {"correspondence_set_ids": [pairs], "models": ["pinhole"], "folds": 0, "schedule": SCHEDULE}
    asked = client.post(
        f"/vehicles/{vehicle}/calibrations", json=body | {"farm": "slots"}, headers={"X-Request-ID": request_id}
    )
    assert asked.status_code == 202, asked.text
    assert asked.headers["X-Request-ID"] == request_id
    return asked.json()["id"]


def _replace_api(fleet: ComposeFleet, name: str) -> None:
    """It says first that it leaves, answers on for a while, and is back."""
    began = time.monotonic()
    fleet.children[name].terminate()
    wait_until(lambda: not fleet.is_api_ready(name), "the process's own word that it leaves", DRAIN_S)
    answer = httpx.get(f"http://127.0.0.1:{fleet.ports[name]}/readyz")
    assert (answer.status_code, answer.json()["status"]) == (503, "draining")
    assert answer.headers["Connection"] == "close"
    fleet.children[name].wait()
    assert time.monotonic() - began >= DRAIN_S
    fleet.start(name)
    wait_until(lambda: fleet.is_api_ready(name), f"the new {name}")


def test_all_processes_are_replaced_and_no_request_fails(
    fleet: ComposeFleet, database: Database, owner: httpx.Client
) -> None:
    fleet.wait_until_healthy((*APIS, *WORKERS), _COMPILING_S)
    fleet_id, vehicle, pairs = _prepare(owner)
    hammers = [Hammer(fleet, fleet_id, name) for name in ("a", "b", "c")]
    follower = Follower(fleet, fleet_id)
    for thread in (*hammers, follower):
        thread.start()
    calibrations: list[str] = []
    for name in APIS:
        calibrations += [_calibrate(owner, vehicle, pairs, f"{REQUEST}-{name}-{number}") for number in range(3)]
        is_first = name == APIS[0]
        if is_first:
            fleet.children["worker-solve"].terminate()
        _replace_api(fleet, name)
        if is_first:
            fleet.children["worker-solve"].wait()
            fleet.start("worker-solve")
    for calibration in calibrations:
        path = f"/calibrations/{calibration}"
        ended = lambda path=path: owner.get(path).json()["state"] == "done"  # noqa: E731
        wait_until(ended, "the calibrations' end", _COMPILING_S, every_s=0.2)
    for thread in (*hammers, follower):
        thread.enough.set()
    for hammer in hammers:
        hammer.join(40)
    print(f"{sum(hammer.asked for hammer in hammers)} requests, {follower.streams} streams")
    assert [failure for hammer in hammers for failure in hammer.failures] == []
    assert follower.failures == []
    assert follower.streams >= 2, "the streams of who left ended, and were followed on elsewhere"
    assert all(hammer.asked > 20 for hammer in hammers)
    with database.reading() as session:
        kept = set(session.scalars(select(Vehicle.name)))
        assert {name for hammer in hammers for name in hammer.made} <= kept
        of_fleet = Job.fleet_id == UUID(fleet_id)
        assert session.scalar(select(func.max(Job.lost)).where(of_fleet)) == 0
        assert set(session.scalars(select(Job.state).where(of_fleet))) == {"done"}
        events = select(JobEvent.what).join(Job, Job.id == JobEvent.job_id).where(of_fleet)
        assert set(session.scalars(events)) <= {"done", "given_back"}


def test_one_id_leads_from_the_request_to_its_rows_and_its_workers_lines(
    fleet: ComposeFleet, database: Database
) -> None:
    """After the restarts above: every line is an object, and one word finds all that a request caused."""
    request_id = f"{REQUEST}-api-2-0"
    api = [line for line in fleet.log_lines("api") if line.get("request_id") == request_id]
    assert [(line["method"], line["status"]) for line in api if "status" in line] == [("POST", 202)]
    with database.reading() as session:
        rows = {job.id: job for job in session.scalars(select(Job).where(Job.request_id == request_id))}
    assert len(rows) > 4, "also the jobs of later iterations, which workers made"
    worker = [line for line in fleet.log_lines("worker") if line.get("request_id") == request_id]
    assert {line["job"] for line in worker} == set(rows)
    assert all({"time", "level", "logger", "message", "kind", "attempt"} <= set(line) for line in worker)
    for kind in ("api", "worker", "sweeper"):
        fleet.log_lines(kind)
    everything = "".join(log.read_text() for log in fleet.logs.glob("*.log"))
    assert fleet.token not in everything and "Bearer" not in everything and "?" + "camera=" not in everything
