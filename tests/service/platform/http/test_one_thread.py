"""What waits for a row's lock holds up nobody else: each route is one call of one thread, and readers have theirs."""

import os
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import partial
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

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.app import ROUTERS
from service.platform.auth.access import read_access, write_access
from service.platform.db.fleets import Fleet, Vehicle
from service.platform.http.router import Route
from service.platform.http.threads import CONNECTIONS, LOCK_S, WAIT_S
from tests.service.calibrations.test_results import seed_results
from tests.service.detections.seeding import seed_rig
from tests.support.databases import one_database
from tests.support.fleets import Processes
from tests.support.people import Actor, Api
from tests.support.processes import free_port, is_ready
from tests.support.uploads import digest, new_recording

# More than a process has threads and connections for them, whatever for.
AT_ONCE = 60
ACCESS = {read_access, write_access}


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


Write = Callable[[httpx.Client, int], httpx.Response]


def publications(api: Api, fleet: UUID, writers: Sequence[Actor]) -> tuple[Write, Any]:
    rig = seed_rig(api.database, fleet)
    results = [seed_results(api, rig)[1][0] for _ in range(2)]
    path = "/v1/results/{}/publication"

    def write(client: httpx.Client, number: int) -> httpx.Response:
        return client.post(path.format(results[number % 2]), json={"reason": f"number {number}"})

    return write, select(Vehicle).where(Vehicle.id == rig.vehicle_id)


def vehicles(api: Api, fleet: UUID, writers: Sequence[Actor]) -> tuple[Write, Any]:
    def write(client: httpx.Client, number: int) -> httpx.Response:
        headers = {"Idempotency-Key": str(uuid4())}
        return client.post(f"/v1/fleets/{fleet}/vehicles", json={"name": f"van {number}"}, headers=headers)

    return write, select(Fleet).where(Fleet.id == fleet)


def parts(api: Api, fleet: UUID, writers: Sequence[Actor]) -> tuple[Write, Any]:
    """Parts of uploads, which take of the fleet's quota."""
    recording = new_recording(writers[0], fleet)["id"]

    def write(client: httpx.Client, number: int) -> httpx.Response:
        data = b"part %d, larger than the recording was announced" % number
        headers = {"Content-Digest": digest(data), "Content-Type": "application/octet-stream"}
        return client.put(f"/v1/recordings/{recording}/parts/{number + 1}", content=data, headers=headers)

    return write, select(Fleet).where(Fleet.id == fleet)


@pytest.fixture
def url(api: Api, tmp_path: Path) -> Iterator[str]:
    """A server process of its own on the test's database, whose threads are no test's."""
    port = free_port()
    server = Processes(tmp_path, os.environ)
    server.commands["api"] = plans.api(DataFolder(tmp_path), {}, "127.0.0.1", port).command
    server.start("api")
    try:
        server.wait(lambda: is_ready(f"http://127.0.0.1:{port}"), "the server's start")
        yield f"http://127.0.0.1:{port}"
    finally:
        server.close()


@pytest.mark.parametrize(
    "kind", [publications, parts, pytest.param(vehicles, marks=pytest.mark.slow)], ids=lambda kind: kind.__name__
)
def test_writers_of_a_row_that_is_held_end_together_and_hold_up_nobody(
    api: Api, url: str, kind: Callable[[Api, UUID, Sequence[Actor]], tuple[Write, Any]]
) -> None:
    fleet, elsewhere = api.fleet(), api.fleet()
    writers = [api.member(fleet, "admin", f"admin {number}") for number in range(2)]
    bystander = api.member(elsewhere, "admin")
    write, row = kind(api, fleet, writers)
    limits = httpx.Limits(max_connections=AT_ONCE)
    has_one_writer = api.database.engine.dialect.name == "sqlite"
    with ExitStack() as stack:
        clients = [
            stack.enter_context(httpx.Client(base_url=url, headers=one.headers, timeout=60, limits=limits))
            for one in (*writers, bystander)
        ]
        pool = stack.enter_context(ThreadPoolExecutor(AT_ONCE + 1))

        def write_timed(number: int) -> tuple[httpx.Response, float]:
            began = time.monotonic()
            return write(clients[number % 2], number), time.monotonic() - began

        def look_on(number: int) -> float:
            """Seconds of a bystander's slowest request."""
            path = f"/v1/fleets/{elsewhere}/vehicles"
            requests = [partial(clients[2].get, one) for one in ("/v1/me", path, "/healthz")]
            if not has_one_writer:
                requests.append(partial(clients[2].post, path, json={"name": f"other van {number}"}))
            took_s = []
            for request in requests:
                began = time.monotonic()
                assert request().status_code in (200, 201)
                took_s.append(time.monotonic() - began)
            return max(took_s)

        with api.database.writing() as session:
            session.scalars(row.with_for_update()).one()
            waiting = [pool.submit(write_timed, number) for number in range(AT_ONCE)]
            looks_s = [look_on(0)]
            while not all(one.done() for one in waiting):
                looks_s.append(look_on(len(looks_s)))
        answers = [one.result() for one in waiting]
        slowest_s = max(seconds for _, seconds in answers)
        print(f"{kind.__name__}: {slowest_s:.2f} s; a bystander's request {max(looks_s):.2f} s")
        refusals = Counter(
            (one.status_code, one.json().get("code"), one.headers.get("retry-after")) for one, _ in answers
        )
        assert set(refusals) <= {(503, "locked", "2"), (503, "busy", "2")}
        assert refusals[503, "locked", "2"]
        # Waiting for a thread and then for locks, 5 s each, took 15 to 26 s.
        assert slowest_s < 3 * WAIT_S - 1
        assert max(looks_s) < WAIT_S
        again = [write(clients[0], number) for number in range(2)]
    assert {one.status_code for one in again} <= {200, 201}


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


def test_one_try_waits_for_a_lock_as_long_as_is_said(api: Api) -> None:
    with api.database.reading() as session:
        is_sqlite = session.get_bind().dialect.name == "sqlite"
        waits = session.connection().exec_driver_sql("PRAGMA busy_timeout" if is_sqlite else "SHOW lock_timeout")
        assert waits.scalar() == (LOCK_S * 1000 if is_sqlite else f"{LOCK_S * 1000:g}ms")


@contextmanager
def _a_full_file(api: Api) -> Iterator[Callable[[], None]]:
    """SQLite's file may not grow, until the given function is called."""

    def limit(most: int) -> None:
        held = [api.database.engine.connect() for _ in range(CONNECTIONS)]
        for one in held:
            one.exec_driver_sql(f"PRAGMA max_page_count={most}")
            one.close()

    with api.database.reading() as session:
        pages = session.connection().exec_driver_sql("PRAGMA page_count").scalar_one()
    limit(pages)
    yield lambda: limit(2**30)


@contextmanager
def _a_full_disk(api: Api) -> Iterator[Callable[[], None]]:
    """PostgreSQL's table of vehicles lies on a disk of one MiB, nearly full until the given function is called."""
    url = api.database.engine.url
    host = str(url.query["host"])
    small = Path(host, f"small-{uuid4().hex}")
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size=1m,uid={Path(host).stat().st_uid},mode=700", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small file system takes root")
    ballast = small / "ballast"
    with ExitStack() as stack:
        stack.callback(subprocess.run, ["umount", str(small)], check=True)
        admin = stack.enter_context(
            psycopg.connect(f"host={host} user=postgres dbname={url.database}", autocommit=True)
        )
        admin.execute(f"CREATE TABLESPACE small LOCATION '{small}'".encode())
        stack.callback(admin.execute, "DROP TABLESPACE small")
        admin.execute("ALTER TABLE vehicle SET TABLESPACE small")
        stack.callback(admin.execute, "ALTER TABLE vehicle SET TABLESPACE pg_default")
        ballast.write_bytes(bytes(900_000))
        yield ballast.unlink


def test_a_full_database_is_named_and_loses_nothing(api: Api) -> None:
    fleet, owner = api.fleet(), api.owner()
    full = _a_full_file if api.database.engine.dialect.name == "sqlite" else _a_full_disk
    with full(api) as make_room:
        made = 0
        while (
            answer := owner.post(f"/fleets/{fleet}/vehicles", {"name": f"{made} " + "x" * 150})
        ).status_code == 201:
            made += 1
            assert made < 1000
        assert (answer.status_code, answer.json()["code"]) == (503, "database_full")
        assert owner.get(f"/fleets/{fleet}/vehicles").status_code == 200
        make_room()
        assert owner.post(f"/fleets/{fleet}/vehicles", {"name": "one more"}).status_code == 201
    with api.database.reading() as session:
        assert len(session.scalars(select(Vehicle.id)).all()) == made + 1
