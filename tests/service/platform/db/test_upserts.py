"""Of two that are the first to write a row neither fails."""

import threading

import pytest
from sqlalchemy import text

from service.platform.db.jobs import JobTotal
from service.platform.jobs.history import _add
from tests.support.processes import wait_until

_WAITING = text("SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock'")


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_two_sweepers_that_count_the_first_of_a_kind_at_once(database):
    failed: list[Exception] = []

    def count() -> None:
        try:
            with database.writing() as session:
                _add(session, "solve", "done", [1.0])
        except Exception as error:
            failed.append(error)

    def waits() -> bool:
        with database.reading() as session:
            return bool(session.scalar(_WAITING))

    beside = threading.Thread(target=count)
    with database.writing() as session:
        _add(session, "solve", "done", [2.0])
        beside.start()
        wait_until(waits, "the second one's wait")
    beside.join()
    assert failed == []
    with database.reading() as session:
        assert session.get_one(JobTotal, ("solve", "done")).count == 2
