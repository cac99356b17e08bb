"""A fleet whose processes are killed one by one, and whose clocks can be set."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import select

from apexcal.client import Client
from apexcal.documents.calibrations import CalibrationView
from apexcal.embedded import plans
from service.platform.db.models import Job
from tests.faults.results import Documents, documents
from tests.support.fleets import Fleet
from tests.support.processes import children, send, wait_until
from tests.support.wrong_clocks import WrongClock, why_not

LEASE_S = 2.0
QUICK = {"LEASE_S": str(LEASE_S), "RENEW_S": "0.4", "RESEND_S": "1", "SWEEP_S": "0.5"}


class Farm(Fleet):
    """One worker of ``processes`` pool processes, and an API that dies where it is told to."""

    def __init__(self, root: Path, database_url: str, processes: int = 2) -> None:
        self.fuse = root / "die"
        super().__init__(root, database_url, processes=processes, DIE_WHILE=str(self.fuse), **QUICK)
        dying = "tests.faults.dying_api:create_app"
        self.commands["api"] = [word.replace("service.app:create_app", dying) for word in self.commands["api"]]
        can_step = not why_not()
        self.clocks = {name: WrongClock(root, name) for name in self.commands} if can_step else {}
        self.own = {name: clock.environment for name, clock in self.clocks.items()}
        try:
            self.start(*self.commands)
            self.wait(self.is_ready, "the farm's start")
        except BaseException:
            super().close()
            raise
        self.client = Client(self.url, self.owner())
        # On a busy machine an API starts more slowly than people have patience for.
        self.client._http._pauses_s = (0.5,) * 240

    def start_beside(self, name: str, environment: dict[str, str], queues: str = plans.QUEUES) -> None:
        """Start one more worker, with an environment of its own."""
        self.commands[name], self.own[name] = plans.worker_command(queues, 2, name), environment
        self.start(name)

    def use_worker(self, processes: int) -> None:
        """Another number of pool processes; a worker that is up with these stays."""
        command = plans.worker_command(plans.QUEUES, processes)
        if command != self.commands["worker"] or self.is_dead("worker"):
            self.stop("worker")
            self.commands["worker"] = command
            self.start("worker")

    @contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """Stop a process and its children for a block; what they hold meanwhile, others must take."""
        pids = [self.pid(name), *children(self.pid(name))]
        send(pids, signal.SIGSTOP)
        try:
            yield
        finally:
            send(pids, signal.SIGCONT)

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

        wait_until(struck, f"work on {kind}")
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

    def finished(self, work: Any, seconds: float = 600.0) -> Any:
        """Follow it to its end, whatever becomes of the API meanwhile."""
        return self.client.wait(work, timeout_s=seconds)

    def close(self) -> None:
        """End everything at once."""
        self.client.close()
        super().close()


def seconds_of(action: Callable[[], Any]) -> float:
    """How long it took."""
    began = time.monotonic()
    action()
    return time.monotonic() - began
