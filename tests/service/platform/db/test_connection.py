"""What a session of PostgreSQL may wait for, as the server itself says."""

from __future__ import annotations

import pytest
from sqlalchemy import text

from service.platform.db.session import Database
from tests.support.postgres import Postgres

_LIMITS = ("statement_timeout", "lock_timeout", "idle_in_transaction_session_timeout")


def said(database: Database, names: tuple[str, ...] = _LIMITS) -> dict[str, str]:
    with database.reading() as session:
        return {name: session.scalar(text(f"SHOW {name}")) for name in names}


@pytest.mark.parametrize(
    ("patient", "query", "expected"),
    [
        (False, "", ("2min", "30s", "1min")),
        (True, "", ("0", "0", "0")),
        (False, "&options=-c%20statement_timeout%3D0", ("0", "30s", "1min")),
    ],
    ids=["the service", "an operator's command", "as the URL says"],
)
def test_sessions_have_limits(postgres: Postgres, patient: bool, query: str, expected: tuple[str, ...]):
    database = Database(postgres.url("apexcal") + query, patient=patient)
    assert tuple(said(database).values()) == expected
    database.close()
