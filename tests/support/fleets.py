"""Fleets of real processes, each with a name: killed, stopped and started again one by one, each with its own log."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.db.grants import OF_API
from service.platform.db.session import Database
from tests.support.broker import Broker
from tests.support.people import add_person
from tests.support.postgres import OF_WORKERS, as_role
from tests.support.processes import free_port, is_ready, start, stop_all, wait_until

# What starting takes on a machine that is busy with other tests.
START_S = 150.0


class Processes:
    """Children by name, with one environment and what is a process's ``own`` beside it.

    What these and ``commands`` say holds from a process's next start on.
    """

    def __init__(self, logs: Path, environment: Mapping[str, str]) -> None:
        self.logs = logs
        self.environment = dict(environment)
        self.commands: dict[str, Sequence[str]] = {}
        self.own: dict[str, Mapping[str, str]] = {}
        self.children: dict[str, subprocess.Popen[bytes]] = {}
        logs.mkdir(parents=True, exist_ok=True)

    def environment_of(self, name: str) -> dict[str, str]:
        """What a process is started with."""
        return {**self.environment, **self.own.get(name, {})}

    def log(self, name: str) -> Path:
        """The file that a process writes to; it goes on when the process is started again."""
        return self.logs / f"{name}.log"

    def launch(self, name: str) -> subprocess.Popen[bytes]:
        """Start a process, and nothing else."""
        return start(list(self.commands[name]), self.log(name), env=self.environment_of(name))

    def start(self, *names: str) -> None:
        """Start processes."""
        for name in names:
            self.children[name] = self.launch(name)

    def pid(self, name: str) -> int:
        """The id of a process."""
        return self.children[name].pid

    def is_dead(self, name: str) -> bool:
        """Whether a process ended."""
        return self.children[name].poll() is not None

    def kill(self, name: str) -> None:
        """SIGKILL a process."""
        self.stop(name, how=signal.SIGKILL)

    def stop(self, *names: str, how: signal.Signals = signal.SIGTERM, grace_s: float = 10.0) -> dict[str, int]:
        """End processes side by side, and wait until they have ended. Returns their exit codes."""
        stop_all([self.children[name] for name in names], how, grace_s)
        return {name: self.children[name].returncode for name in names}

    def wait(self, true: Callable[[], bool], what: str, seconds: float = START_S, every_s: float = 0.02) -> None:
        """`wait_until`, which fails at once when a process has ended meanwhile, and says its last words."""

        def true_and_alive() -> bool:
            for name in self.children:
                assert not self.is_dead(name), f"{name} ended: {self.log(name).read_text()[-2000:]}"
            return true()

        wait_until(true_and_alive, what, seconds, every_s)

    def close(self) -> None:
        """End everything at once."""
        stop_all(self.children.values(), signal.SIGKILL)


class Fleet(Processes):
    """`api`, `worker` and `sweeper` by the commands of `apexcal serve`, on a database, with a broker of their own."""

    def __init__(
        self,
        folder: Path,
        database_url: str,
        *,
        processes: int = 1,
        broker: Broker | None = None,
        logs: Path | None = None,
        **settings: str,
    ) -> None:
        data, self.port = DataFolder(folder), free_port()
        self.folder, self.database_url, self.url = folder, database_url, f"http://127.0.0.1:{self.port}"
        self.broker, self.database = broker or Broker(), Database(database_url)
        environment = {
            **plans.environment(data, public_url=self.url, workers=processes),
            "APEXCAL_DATABASE_URL": database_url,
            "APEXCAL_BROKER_URL": self.broker.url,
            "APEXCAL_MIN_FREE_BYTES": "0",
            **{f"APEXCAL_{name}": value for name, value in settings.items()},
        }
        del environment["APEXCAL_SUPERVISOR_STATUS"]
        super().__init__(logs or data.logs, environment)
        self.commands = {
            "api": plans.api(data, {}, "127.0.0.1", self.port).command,
            "worker": plans.worker_command(plans.QUEUES, processes),
            "sweeper": plans.sweeper(data, {}).command,
        }

    def environment_of(self, name: str) -> dict[str, str]:
        """What a process is started with. Each has its own role of PostgreSQL, as in docker-compose.yml."""
        environment = super().environment_of(name)
        role = OF_API if name == "api" else OF_WORKERS
        return environment | {"APEXCAL_DATABASE_URL": as_role(environment["APEXCAL_DATABASE_URL"], role)}

    def is_ready(self) -> bool:
        """Whether a balancer would ask the API."""
        return is_ready(self.url, 30)

    def owner(self) -> str:
        """The token of a new owner."""
        return add_person(self.database, "owner", owner=True)[1]

    def close(self) -> None:
        """End everything at once."""
        super().close()
        self.database.close()
        self.broker.close()


def inherited() -> dict[str, str]:
    """The caller's environment without settings of ours."""
    return {name: value for name, value in os.environ.items() if not name.startswith("APEXCAL_")}
