"""Real parts for all tests: both databases, a broker, and the application on a data folder of its own."""

import gc
import os
import shutil
import sqlite3
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import UUID

import pytest
import uvicorn

from service.app import create_app
from service.platform.db.fleets import Rig
from service.platform.db.migrate import upgrade
from service.platform.db.models import Base
from service.platform.db.session import Database
from service.platform.http.connections import PatientProtocol
from service.platform.settings import Settings, get_settings
from service.platform.storage.store import open_store
from tests.service.detections.seeding import seed_rig
from tests.support.broker import Broker
from tests.support.people import Actor, Api, TestClient
from tests.support.postgres import Postgres
from tests.support.processes import wait_until
from tests.support.s3 import S3Server
from tests.support.side_by_side import pytest_collection_modifyitems, pytest_xdist_make_scheduler  # noqa: F401
from tests.support.statements import compile_once
from workers.tasks.context import Context

pytest_plugins = ["tests.support.draws"]

_DATABASE = "apexcal"

_MEMORY, _ROOM_BYTES = Path("/dev/shm"), 4 * 2**30

compile_once()


def pytest_configure() -> None:
    """Keep what tests write in memory where there is room: on a disk each commit of SQLite waits for it."""
    if "TMPDIR" not in os.environ and _MEMORY.is_dir() and shutil.disk_usage(_MEMORY).free > _ROOM_BYTES:
        os.environ["TMPDIR"] = str(_MEMORY)
        tempfile.tempdir = None


def pytest_collection_finish() -> None:
    """What was collected stays until the end: nobody looks for garbage there."""
    gc.freeze()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL server with a migrated database."""
    server = Postgres()
    try:
        server.migrated(_DATABASE)
        yield server
    finally:
        server.close()


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A migrated SQLite file to copy."""
    path = tmp_path_factory.mktemp("sqlite") / "template.db"
    upgrade(f"sqlite:///{path}")
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    return path


@pytest.fixture(scope="session")
def broker_server() -> Iterator[Broker]:
    """A broker for the whole session."""
    server = Broker()
    try:
        yield server
    finally:
        server.close()


@pytest.fixture
def broker(broker_server: Broker) -> Broker:
    """A running, empty broker."""
    if broker_server.child.poll() is not None:
        broker_server.start()
    broker_server.empty()
    return broker_server


@pytest.fixture(scope="session")
def s3_server() -> Iterator[S3Server]:
    """An S3 server for the whole session; every store asks it for a bucket of its own."""
    server = S3Server()
    try:
        yield server
    finally:
        server.close()


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path, numbered_ids: None) -> Iterator[str]:
    """An empty, migrated database; every test that uses it runs on both kinds."""
    if request.param == "sqlite":
        path = tmp_path / "apexcal.db"
        shutil.copy(request.getfixturevalue("sqlite_template"), path)
        yield f"sqlite:///{path}"
        return
    server: Postgres = request.getfixturevalue("postgres")
    server.empty(_DATABASE, [table.name for table in reversed(Base.metadata.sorted_tables)])
    yield server.url(_DATABASE)


@pytest.fixture
def settings(
    database_url: str, broker: Broker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Settings]:
    """The process's settings: this test's database and folder, and the session's broker."""
    monkeypatch.setenv("APEXCAL_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setenv("APEXCAL_DATABASE_URL", database_url)
    monkeypatch.setenv("APEXCAL_MIN_FREE_BYTES", "0")
    monkeypatch.setenv("APEXCAL_BROKER_URL", broker.url)
    get_settings.cache_clear()
    open_store(get_settings()).prepare()
    yield get_settings()
    get_settings.cache_clear()


@pytest.fixture
def database(settings: Settings) -> Iterator[Database]:
    """Sessions on a fresh database."""
    opened = Database(settings.database)
    yield opened
    opened.close()


@pytest.fixture
def make_api(settings: Settings) -> Iterator[Callable[..., Api]]:
    """Serve the application, with some settings changed."""
    served: list[TestClient] = []

    def make(**changed: object) -> Api:
        app = create_app(settings.model_copy(update=changed))
        client = TestClient(app, base_url="http://127.0.0.1:8000", raise_server_exceptions=False)
        client.__enter__()
        served.append(client)
        return Api(app, client)

    yield make
    for client in served:
        client.__exit__(None, None, None)


@pytest.fixture
def api(make_api: Callable[..., Api]) -> Api:
    """The served application."""
    return make_api()


@pytest.fixture
def fleet(api: Api) -> UUID:
    """A fleet without anything in it."""
    return api.fleet()


@pytest.fixture
def engineer(api: Api, fleet: UUID) -> Actor:
    """An engineer of that fleet."""
    return api.member(fleet, "engineer")


@pytest.fixture
def rig(api: Api, fleet: UUID) -> Rig:
    """A rig of that fleet with one camera."""
    return seed_rig(api.database, fleet)


@pytest.fixture
def context(settings: Settings) -> Iterator[Context]:
    """A worker's context on this test's database."""
    made = Context(settings)
    yield made
    made.database.close()


@pytest.fixture
def client(api: Api) -> TestClient:
    """A client of the served application that nobody is signed in on."""
    return api.client


@pytest.fixture
def served(api: Api) -> Iterator[tuple[Api, str]]:
    """The application behind a real HTTP server, and its address: for streams, which a test client joins up."""
    config = uvicorn.Config(
        api.app, port=0, log_level="warning", timeout_graceful_shutdown=1, http=PatientProtocol, ws="none"
    )
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    wait_until(lambda: server.started, "the start of the HTTP server")
    port = server.servers[0].sockets[0].getsockname()[1]
    yield api, f"http://127.0.0.1:{port}"
    server.should_exit = True
    thread.join(10)
