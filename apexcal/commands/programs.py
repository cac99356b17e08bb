"""Commands that start the service's and the workers' own programs: ``serve``, ``worker``, ``admin``, ``simulate``."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.terminal import complain, console, note, usage
from apexcal.embedded.folder import DEFAULT, DataFolder, FolderInUseError
from apexcal.embedded.plans import MOST_PROCESSES as MOST
from apexcal.embedded.plans import QUEUES, worker_command
from apexcal.embedded.run import Serving, StartError
from apexcal.embedded.run import serve as serve_embedded

_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_ADDRESS = re.compile(r"https?://[^/\s#?]+(/[^\s#?]*)?$")
_EXAMPLE = "http://<this machine's name>:8000"
# Without the last one each host would keep its objects in a folder of its own.
_NEEDED = ("APEXCAL_DATABASE_URL", "APEXCAL_BROKER_URL", "APEXCAL_BLOB_URL")
_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


def serve(
    data: Path = DEFAULT,
    host: str = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8000,
    public_url: str = "",
    workers: Annotated[int, typer.Option(min=0, max=MOST)] = 0,
    as_json: Annotated[bool, typer.Option("--json")] = False,
) -> None:
    """Start the whole service on this machine: API and pages, broker, workers, sweeper. Ctrl-C stops it.

    It prints a one-time link that signs its owner in. Without --host only this machine reaches it.

    Args:
        data: Folder for everything that the service keeps.
        host: Address to listen on; 0.0.0.0 opens it to the network.
        port: Port to listen on; 0 takes a free one.
        public_url: Where colleagues' browsers find the service.
        workers: Worker processes; 0 for one per core, at least two.
        as_json: Print its address as one line of JSON.
    """
    if host not in _LOOPBACK and not public_url:
        usage(
            f"with --host {host} people come from elsewhere, so the service must know its own address",
            f"Add --public-url {_EXAMPLE}; an https address where a proxy adds encryption",
        )
    if public_url and not _ADDRESS.match(public_url):
        usage(f"--public-url {public_url!r} is no address of a service", f"Write it as {_EXAMPLE}")
    folder = data.resolve()
    try:
        serve_embedded(
            DataFolder(folder),
            host=host,
            port=port,
            public_url=public_url.rstrip("/") or None,
            workers=workers or max(2, os.cpu_count() or 2),
            on_ready=_say_json if as_json else _say,
            on_stopping=lambda: note("Stopping ..."),
            on_closed=lambda: note(f"Other users could read {folder}. It is closed to them now (mode 0700)."),
        )
    except FolderInUseError as error:
        complain(str(error), "Use that one, stop it, or choose another folder with --data.")
    except StartError as error:
        complain(str(error), error.hint)


def worker(
    queues: str = QUEUES, processes: Annotated[int, typer.Option(min=0, max=MOST)] = 0, name: str = "apexcal"
) -> None:
    """Start a worker of a fleet on this host.

    It reads the same settings as the service: APEXCAL_DATABASE_URL, APEXCAL_BROKER_URL, APEXCAL_BLOB_URL.
    SIGTERM lets it finish or give back what it holds. (`apexcal serve` starts its own worker.)

    Args:
        queues: Queues to work for, separated by commas.
        processes: Pool processes; 0 for one per core.
        name: Name of this worker; the host's name is added.
    """
    missing = [key for key in _NEEDED if not os.environ.get(key)]
    if missing:
        usage(f"a worker needs {' and '.join(missing)}", "Give it the environment that the service has")
    names = [queue.strip() for queue in queues.split(",")]
    unknown = [queue for queue in names if queue not in QUEUES.split(",")]
    if unknown:
        usage(f"there is no queue {', '.join(map(repr, unknown))}", f"The queues are {QUEUES}")
    if not _NAME.fullmatch(name):
        usage(f"--name {name!r} is no name of a worker", "It has letters, digits, `-`, `_` and `.`, at most 64")
    command = worker_command(",".join(names), processes or os.cpu_count() or 1, name)
    os.execve(command[0], command, {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", **os.environ})


def admin(context: typer.Context) -> None:
    """Look after a service: back up and restore, people, jobs, retention."""
    _become("admin", "service.admin", data_first(context.args))


def simulate(context: typer.Context) -> None:
    """Write a recording of a simulated rig with its ground truth."""
    _become("simulate", "workers.simulation", context.args)


def _become(name: str, module: str, words: Sequence[str]) -> None:
    """Become the program that defines this command, its options and its help."""
    command = (sys.executable, "-m", module, *words)
    os.execve(command[0], command, {**os.environ, "APEXCAL_COMMAND": f"apexcal {name}"})


def data_first(words: Sequence[str]) -> list[str]:
    """The words with ``--data FOLDER`` moved to the front, where the service's command line looks for it.

    All other commands of apexcal take ``--data`` after their own name, so people write it there.
    """
    first: list[str] = []
    rest: list[str] = []
    remaining = iter(words)
    for word in remaining:
        folder = next(remaining, None) if word == "--data" else None
        if folder is not None:
            first += [word, folder]
        elif word.startswith("--data="):
            first.append(word)
        else:
            rest.append(word)
        if word == "--":
            rest += remaining
    return first + rest


def _say(serving: Serving) -> None:
    out = console()
    folder = serving.owner_token_file.parent
    out.print(f"\n[bold]apexcal[/] is at [bold]{serving.public_url}[/] with {serving.workers} worker processes.\n")
    out.print("Sign in as its owner with this link; it works once:")
    out.print(f"  {serving.owner_link}\n", soft_wrap=True, highlight=False)
    out.print("Invite people from the page, or from another terminal:")
    invite = f"  apexcal invite NAME --role annotator --data {shlex.quote(str(folder))} [--fleet FLEET]\n"
    out.print(invite, markup=False, highlight=False, soft_wrap=True)
    out.print(f"Data is in {folder}. Ctrl-C stops the service.", soft_wrap=True, highlight=False)


def _say_json(serving: Serving) -> None:
    print(json.dumps(asdict(serving), default=str), flush=True)
