"""A host that vanishes answers nothing, not even that it is gone: nobody waits for it longer than a few seconds."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from service.platform.db.connection import CONNECT_S, SILENCE_S
from service.platform.db.migrate import upgrade
from service.platform.db.session import Database
from service.platform.jobs.reaper import reap
from service.platform.storage.store import Store
from tests.support.folders import folder_store
from tests.support.networks import Host, Network, network, why_not
from tests.support.postgres import Postgres
from tests.support.processes import stop, wait_until

pytestmark = [pytest.mark.faults, pytest.mark.skipif(bool(why_not()), reason=f"no host can vanish here: {why_not()}")]

# For a machine that is busy with other tests.
_BUSY_S = 10.0
_BEAT = "SELECT * FROM heartbeat WHERE name = 'sweep' FOR UPDATE"


@pytest.fixture(scope="module")
def hosts() -> Iterator[Network]:
    with network() as made:
        yield made


@pytest.fixture(scope="module")
def server(hosts: Network) -> Iterator[Postgres]:
    """A database on a host of its own; the tests themselves reach it by its socket."""
    server = Postgres(durable=True, host=hosts.host())
    upgrade(server.create("vanishing"))
    yield server
    server.close()


class Sweeper(threading.Thread):
    """Sweeps without a pause on a host of its own."""

    def __init__(self, host: Host, url: str, store: Store) -> None:
        super().__init__(daemon=True)
        self._host, self._url, self._store = host, url, store
        self.done = 0
        self.enough = threading.Event()

    def run(self) -> None:
        self._host.enter()
        database = Database(self._url)
        while not self.enough.wait(0.05):
            try:
                reap(database, self._store)
                self.done += 1
            except OperationalError:
                pass
        database.close()


def test_what_a_host_had_locked_is_free_seconds_after_it_vanished(hosts: Network, server: Postgres):
    """Within a transaction, with nothing on its way: without probes the server would keep the locks for two hours."""
    lost = hosts.host()
    with lost.inside():
        client = Database(server.remote_url("vanishing"))
        holder = client.engine.connect()
    beside = Database(server.url("vanishing"))
    with beside.writing() as session:
        session.execute(text("INSERT INTO heartbeat (name, at) VALUES ('sweep', 0)"))
    holder.execute(text(_BEAT))
    lost.vanish()
    began = time.monotonic()
    with beside.writing() as session:
        session.execute(text(_BEAT)).one()
    assert time.monotonic() - began < SILENCE_S + _BUSY_S
    beside.close()
    holder.invalidate()
    client.close()


def test_the_sweep_goes_on_when_another_host_has_the_databases_address(
    hosts: Network, server: Postgres, tmp_path: Path
):
    """Its statement had arrived, and the answer never will: the new host knows nothing of it."""
    sweeper = Sweeper(hosts.host(), server.remote_url("vanishing"), folder_store(tmp_path / "blobs"))
    sweeper.start()
    wait_until(lambda: sweeper.done > 2, "the first sweeps")
    beside = Database(server.url("vanishing"))
    assert server.host
    with beside.engine.connect() as holder:
        holder.execute(text(_BEAT))
        before = _waiting_for_it(beside, sweeper)
        server.host.vanish()
    beside.close()
    stop(server.child, signal.SIGKILL)
    server.host = hosts.replace(server.host)
    server.start()
    wait_until(lambda: sweeper.done > before, "the next sweep", SILENCE_S + CONNECT_S + _BUSY_S)
    sweeper.enough.set()
    sweeper.join(30)


def _waiting_for_it(database: Database, sweeper: Sweeper) -> int:
    """Wait until a sweep waits for the heartbeat's row. Returns how many there have been."""
    waits = text("SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock'")

    def waiting() -> bool:
        with database.reading() as session:
            return bool(session.scalar(waits))

    wait_until(waiting, "a sweep that waits")
    return sweeper.done
