"""A small fleet of real processes on PostgreSQL: two API processes behind the shipped proxy, workers, sweeper."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.auth.credential_actions import TOKEN_PREFIX, new_secret, secret_hash
from service.platform.db.models import ApiToken, Person
from service.platform.db.session import Database
from tests.support.broker import Broker
from tests.support.compose import ROOT
from tests.support.processes import free_port, is_ready, start, stop, wait_until

DRAIN_S = 2.0
# Written past every logger, from the handler of the signal.
_CELERY_SAYS = "worker: Warm shutdown (MainProcess)"
_API = (
    *("-m", "uvicorn", "service.app:create_app", "--factory", "--host", "127.0.0.1", "--no-access-log"),
    *("--http", "service.platform.http.connections:PatientProtocol"),
)


class Fleet:
    """``api-0``, ``api-1``, ``worker-0``, ``worker-1`` and ``sweeper``, started and stopped by name."""

    def __init__(self, root: Path, database_url: str) -> None:
        self.database = Database(database_url)
        self.broker = Broker()
        self.logs = root / "logs"
        self.logs.mkdir(parents=True)
        folder = DataFolder(root)
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith("APEXCAL_")},
            "APEXCAL_DATA_DIR": str(root),
            "APEXCAL_DATABASE_URL": database_url,
            "APEXCAL_BROKER_URL": self.broker.url,
            "APEXCAL_MIN_FREE_BYTES": "0",
            "APEXCAL_DRAIN_S": str(DRAIN_S),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "PYTHONUNBUFFERED": "1",
        }
        self.ports = [free_port(), free_port()]
        worker = plans.worker_command(plans.QUEUES, 1)
        self._commands: dict[str, list[str]] = {
            **{f"api-{n}": [sys.executable, *_API, "--port", str(port)] for n, port in enumerate(self.ports)},
            **{f"worker-{n}": [word.replace("apexcal@", f"w{n}@") for word in worker] for n in range(2)},
            "sweeper": list(plans.sweeper(folder, {}).command),
        }
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self.proxy_port, store, health = free_port(), free_port(), free_port()
        self._commands["proxy"] = [
            str(Path(sys.executable).parent / "caddy"),
            "run",
            "--config",
            str(ROOT / "Caddyfile"),
        ]
        self.environment |= {
            "APEXCAL_PUBLIC_URL": f"http://127.0.0.1:{self.proxy_port}",
            "APEXCAL_S3_PUBLIC_ENDPOINT": f"http://127.0.0.1:{store}",
            "APEXCAL_PROXY_HEALTH": str(health),
            "APEXCAL_BACKENDS": " ".join(f"127.0.0.1:{port}" for port in self.ports),
            "XDG_DATA_HOME": str(root / "proxy"),
            "XDG_CONFIG_HOME": str(root / "proxy"),
        }
        try:
            for name in self._commands:
                self.start(name)
            wait_until(lambda: all(map(self.is_ready, self.ports)), "both API processes' readiness", 150)
            wait_until(lambda: self.is_ready(self.proxy_port), "the proxy's start", 30)
            self.token = self._make_owner()
        except BaseException:
            self.close()
            raise

    @property
    def url(self) -> str:
        """Where clients find the fleet."""
        return f"http://127.0.0.1:{self.proxy_port}"

    def is_ready(self, port: int) -> bool:
        """What /readyz says there."""
        return is_ready(f"http://127.0.0.1:{port}")

    def start(self, name: str) -> None:
        """Start one process; its log goes on."""
        self._children[name] = start(self._commands[name], self.logs / f"{name}.log", env=self.environment)

    def ask_to_stop(self, name: str) -> None:
        """SIGTERM."""
        self._children[name].send_signal(signal.SIGTERM)

    def wait_for_end(self, name: str, seconds: float) -> int:
        """Its exit code. Raises subprocess.TimeoutExpired where it does not end."""
        return self._children[name].wait(seconds)

    def lines(self, kind: str) -> list[dict[str, Any]]:
        """Every line that processes of a kind logged. Each is an object: nothing else may get in between."""
        found: list[dict[str, Any]] = []
        for log in sorted(self.logs.glob(f"{kind}*.log")):
            lines = (line for line in log.read_text().splitlines() if line.strip() and line != _CELERY_SAYS)
            found += map(json.loads, lines)
        return found

    def close(self) -> None:
        """Stop everything."""
        for child in reversed(self._children.values()):
            stop(child, signal.SIGKILL)
        self.database.close()
        self.broker.close()

    def _make_owner(self) -> str:
        secret = new_secret(TOKEN_PREFIX)
        with self.database.writing() as session:
            person = Person(name="owner", is_owner=True)
            session.add(person)
            session.flush()
            session.add(ApiToken(secret_hash=secret_hash(secret), name="test", person_id=person.id))
        return secret
