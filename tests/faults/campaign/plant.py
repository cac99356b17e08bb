"""The fleet under test: every process by name, started again a moment after its death as a supervisor would."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.db.migrate import upgrade
from service.platform.db.session import Database
from service.platform.storage.store import Store
from tests.faults.farm import QUICK
from tests.support.broker import Broker
from tests.support.networks import Host, Network
from tests.support.postgres import Postgres
from tests.support.processes import free_port, is_ready, start, stop, stop_all, wait_until
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
_AHEAD = ("worker-b", "sweeper")
HOSTS = tuple(dict.fromkeys(_ELSEWHERE.values()))
POOL = 2


class Part:
    """A process that is kept running."""

    def __init__(
        self, launch: Callable[[], subprocess.Popen[bytes]], child: subprocess.Popen[bytes] | None = None
    ) -> None:
        self._launch = launch
        self.child = child or launch()
        self._due: float | None = None

    def watch(self, random: Random) -> None:
        """Start it again where it is dead and its pause is over."""
        if self.child.poll() is None:
            return
        now = time.monotonic()
        if self._due is None:
            self._due = now + random.uniform(*_PAUSE_S)
        elif now >= self._due:
            self._due = None
            self.child = self._launch()


class Plant:
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
        self.data = data
        self.logs = logs
        self._random = random
        self.postgres = Postgres(durable=True, host=self._host("postgres"))
        self.broker = Broker(self._host("broker"))
        url = self.postgres.create("campaign")
        upgrade(url)
        self.database = Database(url)
        self.url = f"http://127.0.0.1:{free_port()}"
        self._folder = DataFolder(data)
        self._bucket = self.s3.make_bucket() if self.s3 else ""
        self.environment = self._environment()
        self.parts: dict[str, Part] = {}
        self._ahead = None if why_not() else WrongClock(logs, "ahead")
        if self._ahead:
            self._ahead.step(CLOCKS_APART_S)

    def begin(self) -> str:
        """Start every process, wait until it is ready, and return the owner's token."""
        token = self.logs / "owner.token"
        bootstrap = [sys.executable, "-m", "service.platform.auth.bootstrap", "--no-link", "--token-file", str(token)]
        subprocess.run(bootstrap, env=self.environment, check=True)
        for name, command in self._commands().items():
            self.parts[name] = Part(self._launcher(name, command))
        self.parts["broker"] = Part(self.broker.launch, self.broker.child)
        self.parts["postgres"] = Part(self.postgres.launch, self.postgres.child)
        return token.read_text().strip()

    def wait_ready(self) -> None:
        """Wait until the service says that it works, and every worker has its pool."""
        wait_until(self._ready, "the start of the plant", _START_S)
        pools = "the start of the workers' pools"
        wait_until(lambda: all(len(self.pool_of(name)) >= POOL for name in WORKERS), pools, _START_S)

    def store(self) -> Store:
        """The store, for looking at it from outside."""
        if self.s3:
            return Store(self.environment["APEXCAL_BLOB_URL"], self.s3.options())
        return Store((self.data / "blobs").as_uri())

    def watch(self) -> None:
        """Start again what is dead."""
        for part in self.parts.values():
            part.watch(self._random)

    def pid(self, name: str) -> int:
        """The process id of a part."""
        return self.parts[name].child.pid

    def pool_of(self, worker: str) -> list[int]:
        """The pool processes of a worker."""
        return children(self.pid(worker))

    def readers(self) -> list[int]:
        """The processes that read an upload at this moment."""
        return [pid for worker in WORKERS for child in self.pool_of(worker) for pid in children(child)]

    def second_sweeper(self) -> subprocess.Popen[bytes]:
        """Start another sweeper, as happens by mistake."""
        return self._launcher("second-sweeper", self._commands()["sweeper"])()

    def stop_service(self) -> None:
        """Stop what could still write; the database goes on."""
        stop_all(self.parts.pop(name).child for name in self._commands())
        stop(self.parts.pop("broker").child)

    def close(self) -> None:
        """Stop everything."""
        for part in self.parts.values():
            stop(part.child)
        self.database.close()
        self.broker.close()
        self.postgres.close()
        if self.s3:
            self.s3.close()

    def _environment(self) -> dict[str, str]:
        database, broker = self.postgres.url("campaign"), self.broker.url
        if self.hosts:
            database, broker = self.postgres.remote_url("campaign"), self.broker.remote_url
        chosen = plans.environment(self._folder, public_url=self.url, workers=POOL * len(WORKERS))
        del chosen["APEXCAL_SUPERVISOR_STATUS"]
        return {
            **chosen,
            "APEXCAL_DATABASE_URL": database,
            "APEXCAL_BROKER_URL": broker,
            "APEXCAL_PART_BYTES": str(1024 * 1024),
            # So that a store that hangs is noticed within the time that it hangs for.
            "APEXCAL_STORE_TIMEOUT_S": "2",
            # Strikes are so close together that five hit the same innocent job. The limit has tests of its own.
            "APEXCAL_MAX_LOST_LEASES": "25",
            **(self.s3.environment(self._bucket) if self.s3 else {}),
            **{f"APEXCAL_{name}": value for name, value in QUICK.items()},
        }

    def _commands(self) -> dict[str, list[str]]:
        port = int(self.url.rpartition(":")[2])
        return {
            "api": list(plans.api(self._folder, self.environment, "127.0.0.1", port).command),
            **{name: list(plans.worker_command(plans.QUEUES, POOL, name)) for name in WORKERS},
            "sweeper": list(plans.sweeper(self._folder, self.environment).command),
        }

    def _launcher(self, name: str, command: list[str]) -> Callable[[], subprocess.Popen[bytes]]:
        def launch() -> subprocess.Popen[bytes]:
            part = name.removeprefix("second-")
            host, clock = self._host(part), self._ahead.environment if self._ahead and part in _AHEAD else {}
            with host.inside() if host else contextlib.nullcontext():
                return start(command, self.logs / f"{name}.log", env=self.environment | clock)

        return launch

    def _host(self, part: str) -> Host | None:
        return self.hosts.get(_ELSEWHERE.get(part, ""))

    def _ready(self) -> bool:
        self.watch()
        return is_ready(self.url, 2)


def children(pid: int) -> list[int]:
    """The children of a process."""
    found: list[int] = []
    for listed in Path("/proc").glob(f"{pid}/task/*/children"):
        with contextlib.suppress(OSError):
            found += [int(word) for word in listed.read_text().split()]
    return found


def send(pids: Sequence[int], signal_number: int) -> None:
    """Send a signal to processes, some of which may be gone."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal_number)
