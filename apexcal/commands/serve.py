"""``apexcal serve``: the service in its embedded form."""

from __future__ import annotations

import json
import os
import re
import shlex
from pathlib import Path
from typing import Annotated

import typer

from apexcal.commands.common import complain, console, usage
from apexcal.embedded.folder import DEFAULT, DataFolder, FolderInUseError
from apexcal.embedded.plans import MOST_PROCESSES as MOST
from apexcal.embedded.run import Serving, StartError
from apexcal.embedded.run import serve as serve_embedded

_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_ADDRESS = re.compile(r"https?://[^/\s#?]+(/[^\s#?]*)?$")
_EXAMPLE = "http://<this machine's name>:8000"


def serve(
    data: Annotated[Path, typer.Option(help="Folder for everything that the service keeps.")] = DEFAULT,
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 opens it to the network.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes a free one.", min=0, max=65535)] = 8000,
    public_url: Annotated[str, typer.Option(help="Where colleagues' browsers find the service.")] = "",
    workers: Annotated[
        int, typer.Option(help="Worker processes; 0 for one per core, at least two.", min=0, max=MOST)
    ] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print its address as one line of JSON.")] = False,
) -> None:
    """Start the whole service on this machine: API and pages, broker, workers, sweeper. Ctrl-C stops it.

    It prints a one-time link that signs its owner in. Without --host only this machine reaches it.
    """
    if host not in _LOOPBACK and not public_url:
        usage(
            f"with --host {host} people come from elsewhere, so the service must know its own address",
            f"Add --public-url {_EXAMPLE}; an https address where a proxy adds encryption",
        )
    if public_url and not _ADDRESS.match(public_url):
        usage(f"--public-url {public_url!r} is no address of a service", f"Write it as {_EXAMPLE}")
    try:
        serve_embedded(
            DataFolder(data.resolve()),
            host=host,
            port=port,
            public_url=public_url.rstrip("/") or None,
            workers=workers or max(2, os.cpu_count() or 2),
            on_ready=_say_json if as_json else _say,
            on_stopping=lambda: console(errors=True).print("Stopping ..."),
            on_closed=lambda: console(errors=True).print(
                f"Other users could read {data.resolve()}. It is closed to them now (mode 0700).", markup=False
            ),
        )
    except FolderInUseError as error:
        complain(str(error), "Use that one, stop it, or choose another folder with --data.")
    except StartError as error:
        complain(str(error), error.hint)


def _say(serving: Serving) -> None:
    out = console()
    folder = serving.owner_token.parent
    out.print(f"\n[bold]apexcal[/] is at [bold]{serving.public_url}[/] with {serving.workers} worker processes.\n")
    out.print("Sign in as its owner with this link; it works once:")
    out.print(f"  {serving.owner_link}\n", soft_wrap=True, highlight=False)
    out.print("Invite people from the page, or from another terminal:")
    invite = f"  apexcal invite NAME --role annotator --data {shlex.quote(str(folder))} [--fleet FLEET]\n"
    out.print(invite, markup=False, highlight=False, soft_wrap=True)
    out.print(f"Data is in {folder}. Ctrl-C stops the service.", soft_wrap=True, highlight=False)


def _say_json(serving: Serving) -> None:
    document = {
        "url": serving.url,
        "public_url": serving.public_url,
        "owner_link": serving.owner_link,
        "owner_token_file": str(serving.owner_token),
        "workers": serving.workers,
    }
    print(json.dumps(document), flush=True)
