"""The real service for a measurement: API, PostgreSQL, broker, a worker with two pool processes, beat and sweeper."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

from apexcal.client import Client
from apexcal.embedded import plans
from apexcal.embedded.children import ChildPlan
from apexcal.embedded.folder import DataFolder
from service.db.migrate import upgrade
from service.db.session import Database
from tests.faults.farm import free_port
from tests.support.postgres import Postgres
from tests.support.processes import start, stop, wait_until

_TICKS = os.sysconf("SC_CLK_TCK")


class House:
    """Brought up in a folder; what its processes do with their time and memory can be read."""

    def __init__(self, root: Path, processes: int = 2) -> None:
        folder = DataFolder(root)
        folder.logs.mkdir(parents=True)
        self._postgres = Postgres(synced=True)
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        try:
            url = self._postgres.create("fleet")
            upgrade(url)
            self.database = Database(url)
            port = free_port()
            self._address = f"http://127.0.0.1:{port}"
            environment = self._environment(folder, url, processes)
            self._start(plans.broker(folder, environment))
            wait_until(lambda: plans.broker_answers(folder.socket), "the start of the broker")
            for plan in (
                plans.api(folder, environment, "127.0.0.1", port),
                plans.worker(folder, environment, processes),
                plans.sweeper(folder, environment),
                plans.beat(folder, environment),
            ):
                self._start(plan)
            token = root / "token"
            bootstrap = [sys.executable, "-m", "service.auth.bootstrap", "--token-file", str(token)]
            subprocess.run(bootstrap, env=environment, check=True, stdout=subprocess.DEVNULL)
            wait_until(self._is_ready, "the start of the service", 90)
            self.client = Client(self._address, token.read_text().strip())
        except BaseException:
            self.close()
            raise

    @property
    def worker_pids(self) -> list[int]:
        """The worker's main process and its pool processes."""
        main = self._children["worker"].pid
        return [main, *_children_of(main)]

    def cpu_s(self) -> dict[str, float]:
        """Processor seconds so far of each part of the service, with all that it started."""
        roots = {name: child.pid for name, child in self._children.items()}
        return {name: cpu_s(pid) for name, pid in (roots | {"postgres": self._postgres.child.pid}).items()}

    def pids(self) -> dict[str, int]:
        """Every process of the service by what it does; of PostgreSQL the first."""
        main, *pool = self.worker_pids
        named = {name: child.pid for name, child in self._children.items() if name != "worker"}
        pooled = {f"worker.pool{number}": pid for number, pid in enumerate(pool)}
        return named | {"worker": main} | pooled | {"postgres": self._postgres.child.pid}

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
        self._postgres.close()

    def _environment(self, folder: DataFolder, url: str, processes: int) -> dict[str, str]:
        environment = plans.environment(folder, public_url=self._address, workers=processes)
        del environment["APEXCAL_SUPERVISOR_STATUS"]
        return environment | {"APEXCAL_DATABASE_URL": url, "APEXCAL_MIN_FREE_BYTES": "0"}

    def _start(self, plan: ChildPlan) -> None:
        self._children[plan.name] = start(list(plan.command), plan.log, env=dict(plan.environment))

    def _is_ready(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self._address}/readyz", timeout=2) as answer:
                return answer.status == 200
        except OSError:
            return False


def _children_of(pid: int) -> list[int]:
    return [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def resident_mib(pid: int) -> float:
    """Resident memory of a process."""
    line = next(one for one in Path(f"/proc/{pid}/status").read_text().splitlines() if one.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def cpu_s(pid: int) -> float:
    """Processor seconds of a process and of everything that it started, ended or not."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / _TICKS + sum(map(cpu_s, _children_of(pid)))
