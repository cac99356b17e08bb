"""One fleet of docker-compose.yml for all tests of this folder: starting it takes longer than what is asked of it."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from tests.integration.fleet import APIS, ComposeFleet
from tests.support.postgres import Postgres
from tests.support.s3 import S3Server


@pytest.fixture(scope="package")
def fleet(
    tmp_path_factory: pytest.TempPathFactory, postgres: Postgres, s3_server: S3Server
) -> Iterator[ComposeFleet]:
    """The fleet, starting. In the end each process must end by itself when it is told to."""
    root = tmp_path_factory.mktemp("fleet")
    running = ComposeFleet(root, postgres, s3_server, APEXCAL_DOWNLOADS="presigned", APEXCAL_DRAIN_S="2")
    try:
        running.begin()
        yield running
        # uvicorn ends by the signal that it was told to end with, once it has ended everything else.
        by_signal = dict.fromkeys(APIS, -signal.SIGTERM)
        assert running.end() == dict.fromkeys(running.commands, 0) | by_signal
    finally:
        running.close()
