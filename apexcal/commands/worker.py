"""``apexcal worker``: starts a worker on another host of a fleet."""

from __future__ import annotations

import os
import re
from typing import Annotated

import typer

from apexcal.commands.common import usage
from apexcal.embedded.plans import MOST_PROCESSES as MOST
from apexcal.embedded.plans import QUEUES, worker_command

# Without the last one each host would keep its objects in a folder of its own.
_NEEDED = ("APEXCAL_DATABASE_URL", "APEXCAL_BROKER_URL", "APEXCAL_BLOB_URL")
_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


def worker(
    queues: Annotated[str, typer.Option(help="Queues to work for, separated by commas.")] = QUEUES,
    processes: Annotated[int, typer.Option(help="Pool processes; 0 for one per core.", min=0, max=MOST)] = 0,
    name: Annotated[str, typer.Option(help="Name of this worker; the host's name is added.")] = "apexcal",
) -> None:
    """Start a worker of a fleet on this host.

    It reads the same settings as the service: APEXCAL_DATABASE_URL, APEXCAL_BROKER_URL, APEXCAL_BLOB_URL.
    SIGTERM lets it finish or give back what it holds. (`apexcal serve` starts its own worker.)
    """
    missing = [key for key in _NEEDED if not os.environ.get(key)]
    if missing:
        usage(f"a worker needs {' and '.join(missing)}", "Give it the environment that the service has")
    wanted = [queue.strip() for queue in queues.split(",")]
    unknown = [queue for queue in wanted if queue not in QUEUES.split(",")]
    if unknown:
        usage(f"there is no queue {', '.join(map(repr, unknown))}", f"The queues are {QUEUES}")
    if not _NAME.fullmatch(name):
        usage(f"--name {name!r} is no name of a worker", "It has letters, digits, `-`, `_` and `.`, at most 64")
    command = worker_command(",".join(wanted), processes or os.cpu_count() or 1, name)
    os.execve(command[0], command, {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **os.environ})
