"""A server process of its own, whose threads are no test's."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest

from tests.support.people import Api
from tests.support.processes import free_port, start, stop, wait_until


class ServedProcess(NamedTuple):
    """Where it answers, and its process id."""

    url: str
    pid: int


@pytest.fixture
def process(api: Api, tmp_path: Path) -> Iterator[ServedProcess]:
    """A server process on the test's database."""
    port = free_port()
    serve = ("-m", "uvicorn", "service.app:create_app", "--factory", "--host", "127.0.0.1", "--no-access-log")
    more = ("--http", "service.platform.http.connections:PatientProtocol", "--port", str(port))
    child = start([sys.executable, *serve, *more], tmp_path / "server.log")
    url = f"http://127.0.0.1:{port}"

    def answers() -> bool:
        try:
            return httpx.get(f"{url}/healthz").status_code == 200
        except httpx.TransportError:
            return False

    wait_until(answers, "the server's start", 120)
    yield ServedProcess(url, child.pid)
    stop(child)
