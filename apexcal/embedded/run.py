"""Starts an embedded service, says where it is, supervises it, and stops it."""

from __future__ import annotations

import http.client
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder, OpenFolderError
from apexcal.embedded.supervisor import Supervisor
from apexcal.processes import tied_to_this

_START_S = 60.0


class StartError(Exception):
    """The service could not start; ``hint`` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True)
class Serving:
    """Where a running embedded service is found."""

    url: str
    public_url: str
    owner_link: str
    owner_token_file: Path
    workers: int


def serve(
    folder: DataFolder,
    *,
    host: str,
    port: int,
    public_url: str | None,
    workers: int,
    on_ready: Callable[[Serving], None],
    on_stopping: Callable[[], None] = lambda: None,
    on_closed: Callable[[], None] = lambda: None,
) -> None:
    """Serve on ``folder`` until SIGTERM or SIGINT. Port 0 takes a free one.

    ``on_closed`` is called where the folder was open to other users and no longer is. Raises :class:`StartError` and
    :class:`apexcal.embedded.folder.FolderInUseError`; nothing is left running then.
    """
    # What this process and its children write is private, even in a folder that somebody opens later.
    os.umask(0o077)
    try:
        if folder.hold():
            on_closed()
    except OpenFolderError as error:
        raise StartError(str(error), error.hint) from None
    except OSError as error:
        raise StartError(
            f"cannot keep data in {folder.root}: {(error.strerror or str(error)).lower()}",
            "Name with --data a folder that you may write in.",
        ) from None
    try:
        port = _free_port(host, port)
        url = f"http://{_bracketed('127.0.0.1' if host in ('0.0.0.0', '::') else host)}:{port}"
        supervisor = Supervisor(folder.status, url, public_url or url)
        settings = plans.environment(folder, public_url=public_url or url, workers=workers)
        try:
            link = _bring_up(supervisor, folder, settings, host, port, workers)
            if not supervisor.stopping:
                on_ready(Serving(url, public_url or url, link, folder.owner_token, workers))
            supervisor.watch()
            on_stopping()
        finally:
            supervisor.stop(plans.STOP_ORDER)
    finally:
        folder.release()


def _bring_up(
    supervisor: Supervisor, folder: DataFolder, settings: Mapping[str, str], host: str, port: int, workers: int
) -> str:
    """Start everything in order and return the owner's one-time link; empty when told to stop meanwhile."""
    supervisor.start(plans.broker(folder, settings))
    mark = ("--mark",) if _lacks_marker(folder, settings) else ()
    printed = _run("service.prepare", ("--token-file", str(folder.owner_token), *mark), settings)
    _wait(supervisor, lambda: plans.broker_answers(folder.socket), "the broker", folder.logs / "broker.log")
    if supervisor.stopping:
        return ""
    supervisor.start(plans.api(folder, settings, host, port))
    supervisor.start(plans.sweeper(folder, settings))
    _wait(supervisor, lambda: _answers(host, port, "/readyz"), "the service", folder.logs)
    if supervisor.stopping:
        return ""
    # They import and compile for long, and would take the cores from what has to answer.
    supervisor.start(plans.worker(folder, settings, workers, plans.COMPUTING))
    supervisor.start(plans.worker(folder, settings, workers, plans.READING, "worker-ingest"))
    link = re.search(r"\S+/sign-in#\S+", printed)
    return link.group(0) if link else ""


def _lacks_marker(folder: DataFolder, settings: Mapping[str, str]) -> bool:
    """Whether an earlier start left a database, and nothing says yet that the folder of objects is its own.

    Where it is not, the API would refuse to start too, and say so in its log only.
    """
    kept_here = not settings.get("APEXCAL_BLOB_URL") and folder.owner_token.exists()
    return kept_here and not (folder.root / "blobs" / ".apexcal-store").exists()


def _wait(supervisor: Supervisor, ready: Callable[[], bool], what: str, log: Path) -> None:
    if not supervisor.until(ready, _START_S) and not supervisor.stopping:
        raise StartError(f"{what} did not come up within {_START_S:.0f} s", f"Look at {log}.")


def _run(module: str, arguments: tuple[str, ...], settings: Mapping[str, str]) -> str:
    """Run one of the service's own modules to its end and return what it printed."""
    done = subprocess.run(
        (sys.executable, "-m", module, *arguments),
        env=dict(settings),
        capture_output=True,
        text=True,
        preexec_fn=tied_to_this(),
    )
    if done.returncode != 0:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
        raise StartError(
            f"the service could not be made ready: {lines[-1] if lines else 'no reason given'}",
            "Nothing was started.",
        )
    return done.stdout


def _answers(host: str, port: int, path: str) -> bool:
    address = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    connection = http.client.HTTPConnection(address, port, timeout=2.0)
    try:
        connection.request("GET", path)
        return connection.getresponse().status == http.client.OK
    except OSError:
        return False
    finally:
        connection.close()


def _free_port(host: str, port: int) -> int:
    """The port, once it is known that it can be listened on. Raises :class:`StartError`."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
            return int(probe.getsockname()[1])
    except socket.gaierror:
        raise StartError(f"{host} is no address of this machine", "Use --host 127.0.0.1 or 0.0.0.0.") from None
    except OSError as error:
        raise StartError(
            f"cannot listen on {host} port {port}: {(error.strerror or str(error)).lower()}",
            "Another program may use the port; say another one, for example --port 8001.",
        ) from None


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
