"""``apexcal worker``: one more host for a fleet's work."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from apexcal.commands.common import usage
from apexcal.embedded.plans import QUEUES, worker_command


def worker(
    queues: Annotated[str, typer.Option(help="Queues to work for, with commas.")] = QUEUES,
    processes: Annotated[int, typer.Option(help="Pool processes; 0 for one per core.", min=0)] = 0,
    name: Annotated[str, typer.Option(help="Name of this worker; the host's name is added.")] = "apexcal",
) -> None:
    """Start a worker of a fleet on this host, in this process's place.

    It reads the same settings as the service: APEXCAL_DATABASE_URL, APEXCAL_BROKER_URL, APEXCAL_BLOB_URL.
    SIGTERM lets it finish or give back what it holds. (`apexcal serve` starts its own worker.)
    """
    missing = [key for key in ("APEXCAL_DATABASE_URL", "APEXCAL_BROKER_URL") if not os.environ.get(key)]
    if missing:
        usage(f"a worker needs {' and '.join(missing)}", "Give it the environment that the service has.")
    unknown = sorted(set(queues.split(",")) - set(QUEUES.split(",")))
    if unknown:
        usage(f"there is no queue {', '.join(unknown)}", f"The queues are {QUEUES}.")
    command = worker_command(queues, processes or os.cpu_count() or 1, name)
    os.execve(command[0], command, {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **os.environ})
