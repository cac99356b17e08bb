"""The fleet under test: every process by name, started again a moment after its death as a supervisor would."""

from __future__ import annotations

import contextlib
import subprocess
import time
from pathlib import Path
from random import Random

from apexcal.embedded import plans
from service.platform.storage.store import Store
from tests.faults.farm import QUICK
from tests.support.broker import Broker
from tests.support.fleets import Fleet
from tests.support.networks import Host, Network
from tests.support.postgres import Postgres
from tests.support.processes import children, is_ready, wait_until
from tests.support.s3 import S3Server
from tests.support.wrong_clocks import WrongClock, why_not

# A pause before a dead process is started again, in seconds.
_PAUSE_S = (0.2, 1.0)
# Seconds on an idle machine; far longer beside other work.
_START_S = 300.0
CLOCKS_APART_S = 300
WORKERS = ("worker-a", "worker-b")
# Who is on a host of their own, where there is a network; all others are where the campaign itself is.
_ELSEWHERE = {
    "postgres": "database",
    "broker": "broker",
    "worker-a": "worker",
    "worker-b": "second_worker",
    "sweeper": "sweeper",
    "s3": "store",
}
HOSTS = tuple(dict.fromkeys(_ELSEWHERE.values()))
POOL = 2
_SETTINGS = {
    "PART_BYTES": str(1024 * 1024),
    # So that a store that hangs is noticed within the time that it hangs for.
    "STORE_TIMEOUT_S": "2",
    # Strikes are so close together that five hit the same innocent job. The limit has tests of its own.
    "MAX_LOST_LEASES": "25",
}


class Plant(Fleet):
    """PostgreSQL, broker, API, two workers of two pool processes and a sweeper on a folder or on S3.

    One worker and the sweeper believe that it is five minutes later. Processes die with the thread that started
    them, so one thread makes, watches and closes the plant.

    On a ``network`` there are hosts for the database, the broker, each worker, the sweeper and S3. The API is on
    another, which this thread enters; it looks at database and broker by their sockets.
    """

    def __init__(
        self, data: Path, logs: Path, random: Random, *, s3: bool = False, network: Network | None = None
    ) -> None:
        self.hosts = {name: network.host() for name in HOSTS} if network else {}
        address = "127.0.0.1"
        if network:
            here = network.host()
            here.enter()
            address = here.address
        self.s3 = S3Server(address, self._host("s3")) if s3 else None
        self._random = random
        self._due: dict[str, float] = {}
        self.postgres = Postgres(durable=True, host=self._host("postgres"))
        url = self.postgres.migrated("campaign")
        broker = Broker(self._host("broker"))
        super().__init__(data, url, processes=POOL * len(WORKERS), broker=broker, logs=logs, **_SETTINGS, **QUICK)
        if self.hosts:
            self.environment["APEXCAL_DATABASE_URL"] = self.postgres.remote_url("campaign")
            self.environment["APEXCAL_BROKER_URL"] = broker.remote_url
        if self.s3:
            self.environment |= self.s3.environment(self.s3.make_bucket())
        del self.commands["worker"]
        self.commands |= {name: plans.worker_command(plans.QUEUES, POOL, name) for name in WORKERS}
        if not why_not():
            ahead = WrongClock(logs, "ahead")
            ahead.step(CLOCKS_APART_S)
            self.own = dict.fromkeys(("worker-b", "sweeper"), ahead.environment)

    def begin(self) -> str:
        """Start every process, and return an owner's token."""
        self.start(*self.commands)
        self.children |= {"broker": self.broker.child, "postgres": self.postgres.child}
        return self.owner()

    def launch(self, name: str) -> subprocess.Popen[bytes]:
        """Start a process on its host."""
        if name == "broker":
            return self.broker.launch()
        if name == "postgres":
            return self.postgres.launch()
        host = self._host(name)
        with host.inside() if host else contextlib.nullcontext():
            return super().launch(name)

    def wait_ready(self) -> None:
        """Wait until the service says that it works, and every worker has its pool."""
        wait_until(self._ready, "the start of the plant", _START_S)
        wait_until(self._has_pools, "the start of the workers' pools", _START_S)

    def store(self) -> Store:
        """The store, for looking at it from outside."""
        if self.s3:
            return Store(self.environment["APEXCAL_BLOB_URL"], self.s3.options())
        return Store((self.folder / "blobs").as_uri())

    def watch(self) -> None:
        """Start again what is dead, a pause after it died."""
        now = time.monotonic()
        for name in filter(self.is_dead, self.children):
            if name not in self._due:
                self._due[name] = now + self._random.uniform(*_PAUSE_S)
            elif now >= self._due[name]:
                del self._due[name]
                self.start(name)

    def pool_of(self, worker: str) -> list[int]:
        """The pool processes of a worker."""
        return children(self.pid(worker))

    def readers(self) -> list[int]:
        """The processes that read an upload at this moment."""
        return [pid for worker in WORKERS for child in self.pool_of(worker) for pid in children(child)]

    def stop_service(self) -> None:
        """Stop what could still write; the database goes on."""
        self.stop(*self.commands)
        self.stop("broker")
        self.children = {"postgres": self.children["postgres"]}

    def close(self) -> None:
        """End everything at once."""
        super().close()
        self.postgres.close()
        if self.s3:
            self.s3.close()

    def _host(self, part: str) -> Host | None:
        return self.hosts.get(_ELSEWHERE.get(part, ""))

    def _has_pools(self) -> bool:
        self.watch()  # a worker may be what was struck last
        return not any(map(self.is_dead, WORKERS)) and all(len(self.pool_of(name)) >= POOL for name in WORKERS)

    def _ready(self) -> bool:
        self.watch()
        return is_ready(self.url, 2)
