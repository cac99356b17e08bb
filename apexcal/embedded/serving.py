"""The service on a folder of this machine: one that runs already, or one that runs for the time of a block."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from apexcal.documents.served_folder import is_served, read_status
from apexcal.errors import ClientError
from apexcal.processes import tied_to_this

WORKERS = 2


class LocalService(NamedTuple):
    """Address, the owner's token, and the owner's one-time sign-in link if the service was started here."""

    url: str
    token: str
    link: str = ""


@contextmanager
def serving(data: Path) -> Iterator[LocalService]:
    """The service on ``data``: the one that runs there already, else one with two worker processes."""
    if is_served(data):
        url = str(read_status(data).get("url") or "")
        if not url:
            raise ClientError(f"an apexcal on {data} is starting or stopping", "Try again in a moment.")
        yield LocalService(url, _token(data))
        return
    command = [sys.executable, "-m", "apexcal.cli", "serve", "--data", str(data), "--port", "0"]
    with subprocess.Popen(
        [*command, "--workers", str(WORKERS), "--json"],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=tied_to_this(),
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line:
                raise ClientError("the service did not start", f"The reason stands above; logs are in {data}/logs.")
            ready = json.loads(line)
            yield LocalService(ready["url"], _token(data), ready["owner_link"])
        finally:
            process.terminate()
            process.wait()


def _token(data: Path) -> str:
    return (data / "owner.token").read_text().strip()
