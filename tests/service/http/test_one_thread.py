"""What waits for a row's lock holds up nobody else: each route is one call of one thread, and readers have theirs."""

import socket
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from inspect import iscoroutinefunction, unwrap
from pathlib import Path
from typing import Any
from uuid import UUID, uuid4

import httpx
import psycopg.errors
import pytest
from fastapi.dependencies.models import Dependant
from sqlalchemy import select
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.app import ROUTERS
from service.auth.access import _read_access, _write_access
from service.db.fleets import Fleet, Vehicle
from service.db.recordings import Recording
from service.http.router import Route
from service.http.threads import CONNECTIONS, LOCK_S
from tests.service.calibrations.test_results import seed_results
from tests.service.detections.seeding import seed_rig
from tests.support.databases import one_database
from tests.support.people import Actor, Api
from tests.support.processes import start, stop, wait_until
from tests.support.uploads import digest, new_recording

# More than a process has threads and connections for them, whatever for.
AT_ONCE = 60
# What stopped everything stopped it for 30 s.
STOP_S = 25.0
ACCESS = {_read_access, _write_access}


def dependencies(of: Dependant) -> Iterator[Dependant]:
    for one in of.dependencies:
        yield one
        yield from dependencies(one)


@pytest.mark.parametrize("route", [one for router in ROUTERS for one in router.routes], ids=lambda one: one.path)
def test_a_route_opens_its_session_in_its_own_call(route: Any) -> None:
    assert isinstance(route, Route)
    own = {one.call for one in route.dependant.dependencies} & ACCESS
    assert not own or not iscoroutinefunction(unwrap(route.endpoint)), "its session would be held over an await"
    assert iscoroutinefunction(route.endpoint), "FastAPI would give it a thread, and then its answer another"
    for one in dependencies(route.dependant):
        assert not {inner.call for inner in one.dependencies} & ACCESS, "a dependency's call would open the session"


@pytest.fixture
def process(api: Api, tmp_path: Path) -> Iterator[str]:
    """A server process on the test's database; its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    serve = ("-m", "uvicorn", "service.app:create_app", "--factory", "--host", "127.0.0.1", "--no-access-log")
    more = ("--http", "service.http.connections:PatientProtocol", "--port", str(port))
    child = start([sys.executable, *serve, *more], tmp_path / "server.log")
    url = f"http://127.0.0.1:{port}"

    def answers() -> bool:
        try:
            return httpx.get(f"{url}/healthz").status_code == 200
        except httpx.TransportError:
            return False

    wait_until(answers, "the server's start", 120)
    yield url
    stop(child)


Write = Callable[[httpx.Client, int], httpx.Response]


def publications(api: Api, fleet: UUID, writer: Actor) -> tuple[Write, Any]:
    rig = seed_rig(api.database, fleet)
    results = [seed_results(api, rig)[1][0] for _ in range(2)]
    path = "/v1/results/{}/publication"

    def write(client: httpx.Client, number: int) -> httpx.Response:
        return client.post(path.format(results[number % 2]), json={"reason": f"number {number}"})

    return write, select(Vehicle).where(Vehicle.id == rig.vehicle_id)


def vehicles(api: Api, fleet: UUID, writer: Actor) -> tuple[Write, Any]:
    def write(client: httpx.Client, number: int) -> httpx.Response:
        headers = {"Idempotency-Key": str(uuid4())}
        return client.post(f"/v1/fleets/{fleet}/vehicles", json={"name": f"van {number}"}, headers=headers)

    return write, select(Fleet).where(Fleet.id == fleet)


def parts(api: Api, fleet: UUID, writer: Actor) -> tuple[Write, Any]:
    recording = new_recording(writer, fleet)["id"]

    def write(client: httpx.Client, number: int) -> httpx.Response:
        data = b"%d" % number
        headers = {"Content-Digest": digest(data), "Content-Type": "application/octet-stream"}
        return client.put(f"/v1/recordings/{recording}/parts/{number + 1}", content=data, headers=headers)

    return write, select(Recording).where(Recording.id == UUID(recording))


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
@pytest.mark.parametrize("kind", [publications, vehicles, parts], ids=lambda kind: kind.__name__)
def test_many_writers_of_one_row_end_and_hold_up_nobody(
    api: Api, process: str, kind: Callable[[Api, UUID, Actor], tuple[Write, Any]]
) -> None:
    fleet, elsewhere = api.fleet(), api.fleet()
    writer, bystander = api.member(fleet, "admin"), api.member(elsewhere, "viewer")
    write, row = kind(api, fleet, writer)
    limits = httpx.Limits(max_connections=AT_ONCE)
    with (
        httpx.Client(base_url=process, headers=writer.headers, timeout=4 * STOP_S, limits=limits) as client,
        httpx.Client(base_url=process, headers=bystander.headers, timeout=STOP_S) as reader,
        ThreadPoolExecutor(AT_ONCE) as pool,
    ):

        def read() -> float:
            began = time.monotonic()
            for path in ("/v1/me", f"/v1/fleets/{elsewhere}/vehicles", "/healthz"):
                assert reader.get(path).status_code == 200
            return time.monotonic() - began

        with api.database.writing() as session:
            session.scalars(row.with_for_update()).one()
            waiting = [pool.submit(write, client, number) for number in range(AT_ONCE)]
            # As long as the row is locked: all threads of writers wait, and nobody's first is done.
            refused = next(one for one in waiting if one.result().status_code == 503).result()
            held_s = max(read() for _ in range(3))
        began = time.monotonic()
        answers = [one.result() for one in waiting]
        assert time.monotonic() - began < STOP_S
    assert (refused.json()["code"], refused.headers["retry-after"]) == ("locked", "2")
    assert {one.status_code for one in answers} <= {200, 201, 503}
    assert {one.json()["code"] for one in answers if one.status_code == 503} <= {"locked", "busy"}
    assert any(one.status_code in (200, 201) for one in answers), "who came later found the row free"
    assert held_s < STOP_S


FAILURES = [
    (psycopg.errors.DiskFull("could not extend file"), "database_full"),
    (psycopg.errors.TooManyConnections("too many connections for role"), "database_busy"),
    (psycopg.OperationalError("connection failed: FATAL:  sorry, too many clients already"), "database_busy"),
    (psycopg.errors.LockNotAvailable("canceling statement due to lock timeout"), "locked"),
    (psycopg.errors.DeadlockDetected("deadlock detected"), "locked"),
    (psycopg.OperationalError("server closed the connection unexpectedly"), "database_unavailable"),
    (Exception("database or disk is full"), "database_full"),
    (Exception("database is locked"), "locked"),
]


@one_database
@pytest.mark.parametrize(("cause", "code"), FAILURES, ids=lambda one: str(one)[:30])
def test_what_a_database_fails_with_is_named(api: Api, cause: Exception, code: str, monkeypatch) -> None:
    owner = api.owner()

    def fail() -> None:
        raise OperationalError("SELECT 1", {}, cause)

    monkeypatch.setattr(api.database, "reading", fail)
    answer = owner.get("/me")
    assert (answer.status_code, answer.json()["code"], answer.headers["retry-after"]) == (503, code, "2")
    assert answer.json()["hint"]


def test_a_pool_without_a_free_connection_is_named(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    owner = api.owner()
    pool: Any = api.database.engine.pool
    monkeypatch.setattr(pool, "_timeout", 0.0)
    held = [api.database.engine.connect() for _ in range(CONNECTIONS)]
    with pytest.raises(PoolTimeout):
        api.database.engine.connect()
    answer = owner.get("/me")
    assert (answer.status_code, answer.json()["code"]) == (503, "database_busy")
    for one in held:
        one.close()
    assert owner.get("/me").status_code == 200


def test_a_lock_is_waited_for_as_long_as_is_said(api: Api) -> None:
    with api.database.reading() as session:
        is_sqlite = session.get_bind().dialect.name == "sqlite"
        waits = session.connection().exec_driver_sql("PRAGMA busy_timeout" if is_sqlite else "SHOW lock_timeout")
        assert waits.scalar() == (LOCK_S * 1000 if is_sqlite else f"{LOCK_S}s")


def test_a_full_database_file_is_named_and_loses_nothing(api: Api) -> None:
    if api.database.engine.dialect.name != "sqlite":
        pytest.skip("a file of its own")
    fleet, owner = api.fleet(), api.owner()
    with api.database.reading() as session:
        pages = session.connection().exec_driver_sql("PRAGMA page_count").scalar_one()

    def limit(most: int) -> None:
        held = [api.database.engine.connect() for _ in range(CONNECTIONS)]
        for one in held:
            one.exec_driver_sql(f"PRAGMA max_page_count={most}")
            one.close()

    limit(pages)
    made = 0
    while (answer := owner.post(f"/fleets/{fleet}/vehicles", {"name": f"{made} " + "x" * 150})).status_code == 201:
        made += 1
        assert made < 400
    assert (answer.status_code, answer.json()["code"]) == (503, "database_full")
    assert owner.get(f"/fleets/{fleet}/vehicles").status_code == 200
    limit(2**30)
    assert owner.post(f"/fleets/{fleet}/vehicles", {"name": "one more"}).status_code == 201
    with api.database.reading() as session:
        assert len(session.scalars(select(Vehicle.id)).all()) == made + 1
