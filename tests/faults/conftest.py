"""One farm per database for all fault tests: starting it takes longer than most of them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest

from apexcal.rigs import read_rig
from tests.faults.farm import Farm
from tests.faults.jobs import Walk
from tests.support import walks
from tests.support.postgres import Postgres


# The fleet's database always, and the embedded one in the long form: tests/apexcal/test_serve.py kills each process
# of the embedded service.
@pytest.fixture(scope="package", params=["postgresql", pytest.param("sqlite", marks=pytest.mark.slow)])
def farm(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, sqlite_template: Path
) -> Iterator[Farm]:
    """Real processes on a fresh database of each kind."""
    root = tmp_path_factory.mktemp("farm") / "data"
    root.mkdir()
    if request.param == "sqlite":
        shutil.copy(sqlite_template, root / "apexcal.db")
        url = f"sqlite:///{root / 'apexcal.db'}"
    else:
        server: Postgres = request.getfixturevalue("postgres")
        url = server.migrated(f"farm_{uuid4().hex}")
    running = Farm(root, url)
    yield running
    running.close()


@pytest.fixture(scope="session")
def walk() -> Walk:
    """A simulated recording, long enough that work on it can be interrupted."""
    folder = walks.walk("plain")
    return Walk(folder / "recording.bag", read_rig(folder / "rig.json", "roof"))
