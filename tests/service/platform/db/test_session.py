"""The ways to the database: statements on their own, and pooled connections that the server has closed."""

from __future__ import annotations

import pytest
from sqlalchemy import insert, select, text
from sqlalchemy.exc import OperationalError, StatementError

from service.platform.db import session as session_module
from service.platform.db.models import Slot
from service.platform.db.session import Database
from tests.service.platform.jobs.support import make_calibration
from tests.support.postgres import Postgres

_INSERT = "INSERT INTO fleet (id, name, version, created_at, row_bytes) VALUES ('{0}', '{0}', 1, 0, 0)"
_COUNT = "SELECT count(*) FROM fleet"


def fleets(database: Database) -> int:
    with database.reading() as session:
        return session.scalar(text(_COUNT)) or 0


def test_a_statement_alone_is_there_at_once_and_for_good(database: Database):
    with pytest.raises(RuntimeError), database.alone() as connection:
        connection.execute(text(_INSERT.format("0" * 32)))
        assert fleets(database) == 1
        raise RuntimeError
    assert fleets(database) == 1


def test_the_same_connection_has_whole_transactions_afterwards(database: Database):
    with database.alone() as connection:
        connection.execute(text(_COUNT))
    with pytest.raises(RuntimeError), database.writing() as session:
        session.execute(text(_INSERT.format("1" * 32)))
        raise RuntimeError
    assert fleets(database) == 0


def test_on_sqlite_a_transaction_is_synced_whatever_the_connection_did_before(database: Database):
    if database.engine.dialect.name != "sqlite":
        pytest.skip("PostgreSQL syncs every commit")
    synchronous = text("PRAGMA synchronous")
    with database.alone() as connection:
        assert connection.scalar(synchronous) == 1
    with database.writing() as session:
        assert session.scalar(synchronous) == 2


@pytest.mark.parametrize("value", [float("inf"), float("nan")])
def test_what_is_no_number_is_not_stored(database: Database, value: float):
    _, (run_id,) = make_calibration(database)
    row = {
        "run_id": run_id,
        "iteration": 0,
        "slot": 0,
        "parameters": [],
        "evaluations": 1,
        "seconds": 1,
        "worker": "w",
    }
    with pytest.raises((StatementError, ValueError), match="not finite"), database.writing() as session:
        session.connection().execute(insert(Slot), [{**row, "loss": value}])
    with pytest.raises((StatementError, ValueError), match="not finite"), database.writing() as session:
        session.add(Slot(**{**row, "parameters": [value]}, loss=1.0))
    with database.reading() as session:
        assert session.scalars(select(Slot)).all() == []


@pytest.fixture
def on_postgres(postgres: Postgres):
    opened = Database(postgres.url("apexcal"))
    yield opened
    opened.close()


def test_readers_leave_a_connection_its_prepared_statements(on_postgres: Database):
    def prepared() -> int:
        with on_postgres.reading() as session:
            return session.scalar(text("SELECT count(*) FROM pg_prepared_statements")) or 0

    for _ in range(10):
        with on_postgres.reading() as session:
            session.execute(text(_COUNT))
        with on_postgres.snapshot() as session:
            session.execute(text(_COUNT))
    assert prepared() > 0


def cut(postgres: Postgres, database: Database) -> None:
    """End the pooled connection's server process from another connection."""
    with database.reading() as session:
        backend = session.scalar(text("SELECT pg_backend_pid()"))
    other = Database(postgres.url("apexcal"))
    with other.reading() as session:
        session.execute(text("SELECT pg_terminate_backend(:pid, 5000)"), {"pid": backend})
    other.close()


def test_a_connection_that_the_server_closed_is_replaced(
    postgres: Postgres, on_postgres: Database, monkeypatch: pytest.MonkeyPatch
):
    cut(postgres, on_postgres)
    monkeypatch.setattr(session_module, "_FRESH_S", 0.0)
    fleets(on_postgres)


def test_one_used_a_moment_ago_is_not_looked_at_and_fails_once(postgres: Postgres, on_postgres: Database):
    cut(postgres, on_postgres)
    with pytest.raises(OperationalError):
        fleets(on_postgres)
    fleets(on_postgres)


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_connection_in_use_while_its_database_closes_is_closed_when_it_comes_back(database_url):
    """As a request's that is still ending while the service stops."""
    closing = Database(database_url)
    with closing.reading() as session:
        driver = session.connection().connection.driver_connection
        closing.close()
        assert not driver.closed
    assert driver.closed
