"""A real embedded service for the client's and the command's tests."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from apexcal.client import Client
from apexcal.embedded.folder import read_status
from tests.apexcal.cars import Car
from tests.support.processes import die_with_parent

SERVE = (sys.executable, "-m", "apexcal.cli", "serve", "--port", "0", "--workers", "2", "--json")


@dataclass
class Embedded:
    """`apexcal serve` as a process of its own."""

    process: subprocess.Popen[str]
    data: Path
    said: dict[str, str]

    @property
    def url(self) -> str:
        return self.said["url"]

    @property
    def token(self) -> str:
        return (self.data / "owner.token").read_text().strip()

    def children(self) -> dict[str, dict]:
        return {child["name"]: child for child in read_status(self.data).get("children", [])}


def start(data: Path, *more: str) -> Embedded:
    command = [*SERVE, "--data", str(data), *more]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=die_with_parent)
    line = process.stdout.readline()
    assert line, f"the service did not start: exit code {process.wait()}"
    return Embedded(process, data, json.loads(line))


def stop(embedded: Embedded) -> int:
    embedded.process.terminate()
    code = embedded.process.wait(40)
    embedded.process.stdout.close()
    return code


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
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a short simulated recording."""
    folder = tmp_path_factory.mktemp("simulated") / "walk"
    command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--seconds", "6"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder
