"""The sweeper recovers everything else: one that gets nowhere ends, so that it is started again."""

import os
from pathlib import Path

import pytest
from sqlalchemy import select

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.db.clock import now
from service.platform.db.models import Heartbeat
from service.platform.db.session import Database
from tests.faults.farm import QUICK
from tests.support.broker import Broker
from tests.support.databases import one_database
from tests.support.processes import start, stop, wait_until

pytestmark = [one_database, pytest.mark.faults]

STALLED_S = 3.0


@pytest.fixture
def environment(broker: Broker, database: Database) -> dict[str, str]:
    quick = {f"APEXCAL_{name}": value for name, value in QUICK.items()}
    return {**os.environ, **quick, "APEXCAL_STALLED_S": str(STALLED_S), "OPENBLAS_NUM_THREADS": "1"}


def test_a_sweeper_that_gets_on_stays_and_one_that_gets_nowhere_ends_and_says_where_it_was(
    environment: dict[str, str], database: Database, tmp_path: Path
) -> None:
    """Another session holds the row that each sweep writes."""

    def sweeps() -> float:
        with database.reading() as session:
            at = session.scalar(select(Heartbeat.at).where(Heartbeat.name == "sweep"))
        return at.timestamp() if at else 0.0

    log = tmp_path / "log"
    child = start(list(plans.sweeper(DataFolder(tmp_path / "data"), {}).command), log, env=environment)
    try:
        wait_until(lambda: sweeps() > 0, "the first sweep")
        until = sweeps() + 1.5 * STALLED_S
        wait_until(lambda: sweeps() > until, "sweeps without a pause")
        assert child.poll() is None
        with database.writing() as session:
            session.merge(Heartbeat(name="sweep", at=now()))
            session.flush()
            wait_until(lambda: child.poll() is not None, "its end")
    finally:
        stop(child)
    assert child.returncode == 1
    assert "Timeout" in log.read_text() and "most recent call first" in log.read_text()
