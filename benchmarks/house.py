"""The real service for a measurement: API, either database, broker, a worker with its pool, sweeper."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal
from uuid import UUID

import redis
from sqlalchemy import select

from apexcal.client import Client
from apexcal.embedded import plans
from apexcal.embedded.children import ChildPlan
from apexcal.embedded.folder import DataFolder
from service.platform.broker.hints import channel
from service.platform.db.jobs import Worker
from service.platform.db.migrate import upgrade
from service.platform.db.session import Database
from tests.support.postgres import Postgres
from tests.support.processes import free_port, start, stop, wait_until

_TICKS = os.sysconf("SC_CLK_TCK")
# musl gives a thread 128 kB, macOS 512: a mebibyte is enough.
_STACK_BYTES = 1 << 20


class House:
    """Brought up in a folder; what its processes do with their time and memory can be read.

    ``api_bytes``: what the API may have of memory.
    """

    def __init__(
        self,
        root: Path,
        processes: int = 2,
        database: Literal["postgresql", "sqlite"] = "postgresql",
        api_bytes: int | None = None,
    ) -> None:
        self.folder = folder = DataFolder(root)
        folder.logs.mkdir(parents=True)
        self.postgres = Postgres(synced=True) if database == "postgresql" else None
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        try:
            self.url = self.postgres.create("apexcal") if self.postgres else f"sqlite:///{root / 'apexcal.db'}"
            upgrade(self.url)
            self.database = Database(self.url)
            port = free_port()
            self.address = f"http://127.0.0.1:{port}"
            environment = self._environment(folder, self.url)
            self._start(plans.broker(folder, environment))
            wait_until(lambda: plans.broker_answers(folder.socket), "the start of the broker")
            api = plans.api(folder, environment, "127.0.0.1", port)
            if api_bytes:
                # What a process may write (setrlimit(2), RLIMIT_DATA), threads' stacks included.
                limits = ("prlimit", f"--data={api_bytes}", f"--stack={_STACK_BYTES}")
                api = replace(api, command=(*limits, *api.command))
            for plan in (
                api,
                plans.worker(folder, environment, processes),
                plans.sweeper(folder, environment),
            ):
                self._start(plan)
            token = root / "token"
            bootstrap = [sys.executable, "-m", "service.platform.auth.bootstrap", "--token-file", str(token)]
            subprocess.run(bootstrap, env=environment, check=True, stdout=subprocess.DEVNULL)
            wait_until(self._is_ready, "the start of the service", 90)
            self.client = Client(self.address, token.read_text().strip())
        except BaseException:
            self.close()
            raise

    @property
    def worker_pids(self) -> list[int]:
        """The worker's main process and its pool processes."""
        main = self._children["worker"].pid
        return [main, *_children_of(main)]

    @property
    def blobs(self) -> str:
        """The address of the store's folder."""
        return (self.folder.root / "blobs").as_uri()

    def lives(self, name: str) -> bool:
        """Whether a part runs."""
        return self._children[name].poll() is None

    def restart_worker(self, processes: int) -> None:
        """Another number of pool processes, started and warm; none for 0."""
        if "worker" in self._children:
            stop(self._children.pop("worker"))
        if processes:
            environment = self._environment(self.folder, self.url)
            self._start(plans.worker(self.folder, environment, processes))
            wait_until(lambda: self._is_warm(processes), "the start of the worker", 90)

    def _is_warm(self, processes: int) -> bool:
        with self.database.reading() as session:
            return session.scalars(select(Worker.processes).where(Worker.warm)).all() == [processes]

    @property
    def broker_url(self) -> str:
        """Celery's URL of the broker."""
        return f"redis+socket://{self.folder.socket}?virtual_host=0"

    @contextmanager
    def changes(self, fleet_id: UUID) -> Iterator[Callable[[float], object]]:
        """What waits for the next hint of the fleet, or for so many seconds: a wait that costs nothing meanwhile."""
        with redis.Redis(unix_socket_path=str(self.folder.socket)) as client, client.pubsub() as hints:
            hints.subscribe(channel(fleet_id))
            hints.get_message(timeout=5.0)
            yield lambda timeout_s: hints.get_message(timeout=timeout_s)

    def broker_calls(self) -> int:
        """How many commands the broker has done so far."""
        with redis.Redis(unix_socket_path=str(self.folder.socket)) as client:
            counts: Any = client.info("commandstats")
        return sum(count["calls"] for count in counts.values())

    def cpu_s(self) -> dict[str, float]:
        """Processor seconds so far of each part of the service, with all that it started."""
        return {name: cpu_s(pid) for name, pid in self._roots().items()}

    def pids(self) -> dict[str, int]:
        """Every process of the service by what it does; of PostgreSQL the first."""
        main, *pool = self.worker_pids
        pooled = {f"worker.pool{number}": pid for number, pid in enumerate(pool)}
        return self._roots() | {"worker": main} | pooled

    def _roots(self) -> dict[str, int]:
        roots = {name: child.pid for name, child in self._children.items()}
        return roots | {"postgres": self.postgres.child.pid} if self.postgres else roots

    def close(self) -> None:
        """Stop everything."""
        for pid in self.worker_pids if "worker" in self._children else []:
            os.kill(pid, signal.SIGCONT)
        if hasattr(self, "client"):
            self.client.close()
        for child in reversed(self._children.values()):
            stop(child)
        if hasattr(self, "database"):
            self.database.close()
        if self.postgres:
            self.postgres.close()

    def _environment(self, folder: DataFolder, url: str) -> dict[str, str]:
        environment = plans.environment(folder, public_url=self.address, workers=2)
        del environment["APEXCAL_SUPERVISOR_STATUS"]
        return environment | {"APEXCAL_DATABASE_URL": url, "APEXCAL_MIN_FREE_BYTES": "0"}

    def _start(self, plan: ChildPlan) -> None:
        self._children[plan.name] = start(list(plan.command), plan.log, env=dict(plan.environment))

    def _is_ready(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.address}/readyz", timeout=2) as answer:
                return answer.status == 200
        except OSError:
            return False


def _children_of(pid: int) -> list[int]:
    return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def resident_mib(pid: int, field: str = "VmRSS") -> float:
    """Resident memory of a process; the most so far is ``VmHWM``."""
    line = next(one for one in Path(f"/proc/{pid}/status").read_text().splitlines() if one.startswith(field))
    return int(line.split()[1]) / 1024


def cpu_s(pid: int) -> float:
    """Processor seconds of a process and of everything that it started, ended or not."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / _TICKS + sum(map(cpu_s, _children_of(pid)))
