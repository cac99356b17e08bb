"""A farm of real processes that can be killed one by one: broker, API, worker, sweeper."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sqlalchemy import select

from apexcal.client import Client
from apexcal.documents.calibrations import CalibrationView
from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.db.models import Job
from service.platform.db.session import Database
from tests.faults.results import Documents, documents
from tests.support.broker import Broker
from tests.support.processes import free_port, is_ready, start, stop, stop_all, wait_until
from tests.support.wrong_clocks import WrongClock, why_not

LEASE_S = 2.0
QUICK = {"LEASE_S": str(LEASE_S), "RENEW_S": "0.4", "RESEND_S": "1", "SWEEP_S": "0.5", "MIN_FREE_BYTES": "0"}


class Farm:
    """Brought up on one database; ``processes`` pool processes in one worker."""

    def __init__(self, root: Path, database_url: str, processes: int = 2) -> None:
        self.root = root
        self.database_url = database_url
        self.broker = Broker()
        self.database = Database(database_url)
        self.fuse = root / "die"
        self.port = free_port()
        folder = DataFolder(root)
        folder.logs.mkdir(parents=True)
        self._environment = {
            **plans.environment(folder, public_url=f"http://127.0.0.1:{self.port}", workers=processes),
            "APEXCAL_DATABASE_URL": database_url,
            "APEXCAL_BROKER_URL": self.broker.url,
            "APEXCAL_DIE_WHILE": str(self.fuse),
            **{f"APEXCAL_{name}": value for name, value in QUICK.items()},
        }
        del self._environment["APEXCAL_SUPERVISOR_STATUS"]
        self._commands = {
            "api": [
                *(sys.executable, "-m", "uvicorn", "tests.faults.dying_api:create_app", "--factory"),
                *("--host", "127.0.0.1", "--port", str(self.port)),
            ],
            "worker": list(plans.worker(folder, self._environment, processes).command),
            "sweeper": list(plans.sweeper(folder, self._environment).command),
        }
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        can_step = not why_not()
        self.clocks = {name: WrongClock(root, name) for name in self._commands} if can_step else {}
        try:
            for name in self._commands:
                self.start(name)
            token = root / "owner.token"
            self._run("service.platform.auth.bootstrap", "--token-file", str(token))
            wait_until(self.is_ready, "the farm's start", 150)
        except BaseException:
            self._stop()
            raise
        self.client = Client(f"http://127.0.0.1:{self.port}", token.read_text().strip())
        # On a busy machine an API starts more slowly than people have patience for.
        self.client._http._pauses_s = (0.5,) * 240

    def start(self, name: str) -> None:
        """Start one kind of process."""
        log = self.root / "logs" / f"{name}.log"
        clock = self.clocks[name].environment if self.clocks else {}
        self._children[name] = start(self._commands[name], log, env=self._environment | clock)

    def start_beside(self, name: str, log: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
        """Start one more worker, with an environment of its own. Who asks for it ends it."""
        return start(list(plans.worker_command(plans.QUEUES, 2, name)), log, env=self._environment | environment)

    def kill(self, name: str) -> None:
        """SIGKILL it."""
        self._children[name].kill()
        self._children[name].wait()

    def stop(self, name: str) -> None:
        """SIGTERM it, and wait until it has stopped."""
        stop(self._children[name])

    def is_dead(self, name: str) -> bool:
        """Whether it ended."""
        return self._children[name].poll() is not None

    def use_worker(self, processes: int, queues: str = plans.QUEUES) -> None:
        """Another number of pool processes, or other queues; a worker that is up with these stays."""
        command = self._commands["worker"]
        places = command.index("--concurrency") + 1, command.index("-Q") + 1
        wanted = (str(processes), queues)
        if tuple(command[place] for place in places) == wanted and not self.is_dead("worker"):
            return
        stop(self._children["worker"])
        for place, word in zip(places, wanted, strict=True):
            command[place] = word
        self.start("worker")

    def kill_who_works_on(self, kind: str, part: str | None = None) -> int:
        """Wait until a pool process works on a job of this kind, kill it, and return the job's id.

        It is stopped first: else a short job might end between the look and the kill.
        """
        killed: list[int] = []

        def struck() -> bool:
            found = self._at_work(kind, part)
            if found is None:
                return False
            job_id, worker = found
            pid = int(worker.rpartition(":")[2])
            os.kill(pid, signal.SIGSTOP)
            if self._at_work(kind, part, job_id) != found:
                os.kill(pid, signal.SIGCONT)
                return False
            os.kill(pid, signal.SIGKILL)
            killed.append(job_id)
            return True

        wait_until(struck, f"work on {kind}", 120)
        return killed[0]

    def _at_work(self, kind: str, part: str | None, job_id: int | None = None) -> tuple[int, str] | None:
        """The newest such job that runs, or this one, and who works on it."""
        asked = select(Job).where(Job.kind == kind, Job.state == "running").order_by(Job.id.desc())
        with self.database.reading() as session:
            for job in session.scalars(asked if job_id is None else asked.where(Job.id == job_id)):
                if part in (None, job.payload.get("part")):
                    return job.id, job.worker or ""
        return None

    def job(self, job_id: int) -> Job:
        """A job's row."""
        with self.database.reading() as session:
            return session.get_one(Job, job_id)

    def documents(self, calibration: CalibrationView) -> Documents:
        """What the calibration's runs found, by camera, model and fold, without the times it took."""
        with self.database.reading() as session:
            return documents(session, calibration.id)

    def finished(self, work: Any, seconds: float = 150.0) -> Any:
        """Follow it to its end, whatever becomes of the API meanwhile."""
        return self.client.wait(work, timeout_s=seconds)

    def close(self) -> None:
        """Stop everything."""
        self.client.close()
        self._stop()

    def _stop(self) -> None:
        stop_all(self._children.values())
        self.database.close()
        self.broker.close()

    def is_ready(self) -> bool:
        """Whether a balancer would ask its API."""
        return is_ready(f"http://127.0.0.1:{self.port}", 30)

    def _run(self, module: str, *arguments: str) -> None:
        subprocess.run([sys.executable, "-m", module, *arguments], env=self._environment, check=True)


def seconds_of(action: Callable[[], Any]) -> float:
    """How long it took."""
    began = time.monotonic()
    action()
    return time.monotonic() - began
