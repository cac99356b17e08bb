"""Which databases a test runs on, where it shall not run on both always."""

import pytest
from sqlalchemy import text

from service.platform.db.session import Database
from tests.support.processes import wait_until

_WAITING = "SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock' AND datname = current_database()"

# What ends before the database is asked, or asks for nothing special: on one always, on the other in the long form.
one_database = pytest.mark.parametrize(
    "database_url", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)], indirect=True
)


def waits_for_a_lock(database: Database) -> bool:
    """Whether a transaction waits for what another holds, by PostgreSQL's own word."""
    with database.alone() as connection:
        return bool(connection.execute(text(_WAITING)).scalar())


def wait_until_one_waits(database: Database) -> None:
    """Wait, within a transaction that writes, until another has come as far as it may.

    On PostgreSQL it waits for a lock. SQLite does not say who waits; there it has a connection of its own.
    """
    on_sqlite = database.engine.dialect.name == "sqlite"
    pool = database.engine.pool
    wait_until(lambda: pool.checkedout() > 1 if on_sqlite else waits_for_a_lock(database), "one that waits")
