"""The real service for a measurement: API, either database, broker, a worker with its pool, sweeper."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal
from uuid import UUID

import redis
from sqlalchemy import select

from apexcal.client import Client
from apexcal.embedded import plans
from apexcal.embedded.children import ChildPlan
from apexcal.embedded.folder import DataFolder
from service.platform.auth.credential_actions import TOKEN_PREFIX, new_secret, secret_hash
from service.platform.broker.hints import channel
from service.platform.db.jobs import Worker
from service.platform.db.migrate import upgrade
from service.platform.db.people import ApiToken, Membership, Person
from service.platform.db.session import Database
from tests.support.postgres import Postgres
from tests.support.processes import free_port, start, stop, wait_until

_TICKS = os.sysconf("SC_CLK_TCK")
# musl gives a thread 128 kB, macOS 512: a mebibyte is enough.
_STACK_BYTES = 1 << 20


class House:
    """Brought up in a folder; what its processes do with their time and memory can be read.

    ``processes``: of the worker's pool; without any there are API and broker alone. ``api_bytes``: what the API may
    have of memory. ``app``: what makes the application.
    """

    def __init__(
        self,
        root: Path,
        processes: int = 2,
        database: Literal["postgresql", "sqlite"] = "postgresql",
        api_bytes: int | None = None,
        app: str = "service.app:create_app",
    ) -> None:
        self.folder = folder = DataFolder(root)
        folder.logs.mkdir(parents=True)
        self.postgres = Postgres(synced=True) if database == "postgresql" else None
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        try:
            self.url = self.postgres.create("apexcal") if self.postgres else f"sqlite:///{root / 'apexcal.db'}"
            upgrade(self.url)
            self.database = Database(self.url)
            self._app, self._api_bytes = app, api_bytes
            self.port = free_port()
            self.address = f"http://127.0.0.1:{self.port}"
            environment = self._environment()
            self._start(plans.broker(folder, environment))
            wait_until(lambda: plans.broker_answers(folder.socket), "the start of the broker")
            self._start_api("api", self.port)
            if processes:
                self._start(plans.worker(folder, environment, processes))
                self._start(plans.sweeper(folder, environment))
            token = root / "token"
            bootstrap = [sys.executable, "-m", "service.platform.auth.bootstrap", "--token-file", str(token)]
            subprocess.run(bootstrap, env=environment, check=True, stdout=subprocess.DEVNULL)
            wait_until(lambda: self._is_ready(self.address), "the start of the service", 90)
            self.client = Client(self.address, token.read_text().strip())
        except BaseException:
            self.close()
            raise

    def _start_api(self, name: str, port: int) -> None:
        api = plans.api(self.folder, self._environment(), "127.0.0.1", port)
        command = tuple(self._app if word == "service.app:create_app" else word for word in api.command)
        if self._api_bytes:
            # What a process may write (setrlimit(2), RLIMIT_DATA), threads' stacks included.
            command = ("prlimit", f"--data={self._api_bytes}", f"--stack={_STACK_BYTES}", *command)
        self._start(replace(api, name=name, command=command))

    def another_api(self) -> str:
        """The address of one more API process."""
        port = free_port()
        self._start_api(f"api-{port}", port)
        wait_until(lambda: self._is_ready(f"http://127.0.0.1:{port}"), "the start of another API", 60)
        return f"http://127.0.0.1:{port}"

    def person(self, fleet_id: UUID, role: str) -> str:
        """The token of a new person of a fleet."""
        secret = new_secret(TOKEN_PREFIX)
        with self.database.writing() as session:
            person = Person(name=role)
            session.add(person)
            session.flush()
            session.add(Membership(person_id=person.id, fleet_id=fleet_id, role=role))
            session.add(ApiToken(person_id=person.id, name="bench", secret_hash=secret_hash(secret)))
        return secret

    @property
    def worker_pids(self) -> list[int]:
        """The worker's main process and its pool processes."""
        main = self._children["worker"].pid
        return [main, *_children_of(main)]

    @property
    def blobs(self) -> str:
        """The address of the store's folder."""
        return (self.folder.root / "blobs").as_uri()

    def restart_worker(self, processes: int) -> None:
        """Another number of pool processes, started and warm; none for 0."""
        if "worker" in self._children:
            stop(self._children.pop("worker"))
        if processes:
            self._start(plans.worker(self.folder, self._environment(), processes))
            wait_until(lambda: self._is_warm(processes), "the start of the worker", 90)

    def _is_warm(self, processes: int) -> bool:
        with self.database.reading() as session:
            return session.scalars(select(Worker.processes).where(Worker.warm)).all() == [processes]

    @contextmanager
    def changes(self, fleet_id: UUID) -> Iterator[Callable[[float], object]]:
        """What waits for the next hint of the fleet, or for so many seconds: a wait that costs nothing meanwhile."""
        with redis.Redis(unix_socket_path=str(self.folder.socket)) as client, client.pubsub() as hints:
            hints.subscribe(channel(fleet_id))
            hints.get_message(timeout=5.0)
            yield lambda timeout_s: hints.get_message(timeout=timeout_s)

    def cpu_s(self) -> dict[str, float]:
        """Processor seconds so far of each part of the service, with all that it started."""
        return {name: cpu_s(pid) for name, pid in self._roots().items()}

    def _roots(self) -> dict[str, int]:
        roots = {name: child.pid for name, child in self._children.items()}
        return roots | {"postgres": self.postgres.child.pid} if self.postgres else roots

    def api_peak_mib(self) -> float | None:
        """The most memory that the API had; None if it ended."""
        api = self._children["api"]
        return resident_mib(api.pid, "VmHWM") if api.poll() is None else None

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

    def _environment(self) -> dict[str, str]:
        environment = plans.environment(self.folder, public_url=self.address, workers=2)
        del environment["APEXCAL_SUPERVISOR_STATUS"]
        return environment | {"APEXCAL_DATABASE_URL": self.url, "APEXCAL_MIN_FREE_BYTES": "0"}

    def _start(self, plan: ChildPlan) -> None:
        self._children[plan.name] = start(list(plan.command), plan.log, env=dict(plan.environment))

    def _is_ready(self, address: str) -> bool:
        try:
            # Without workers it is degraded, and answers.
            with urllib.request.urlopen(f"{address}/readyz", timeout=2) as answer:
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


def percentile(values: Sequence[float], share: float) -> float:
    """The value that this share of the values does not exceed."""
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]
