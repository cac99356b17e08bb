"""A real embedded service for the client's and the command's tests."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from apexcal.client import Client
from tests.apexcal.cars import Car
from tests.support.served import Embedded, start, stop
from tests.support.walks import walk


@pytest.fixture(scope="session")
def embedded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Embedded]:
    """Of all tests of these folders. Its folder was open to others before, and who starts it lets them read."""
    data = tmp_path_factory.mktemp("embedded") / "data"
    data.mkdir()
    data.chmod(0o755)
    umask = os.umask(0o002)
    try:
        served = start(data)
    finally:
        os.umask(umask)
    try:
        yield served
    finally:
        stop(served)


@pytest.fixture
def car(served, tmp_path: Path) -> Car:
    """On a service within this process, with a folder of its own."""
    (tmp_path / "car").mkdir()
    return Car(served, tmp_path / "car")


@pytest.fixture
def owner(embedded: Embedded) -> Iterator[Client]:
    with Client(embedded.url, embedded.token) as client:
        yield client


@pytest.fixture(scope="session")
def simulated() -> Path:
    """A folder with a short simulated recording."""
    return walk("short")
