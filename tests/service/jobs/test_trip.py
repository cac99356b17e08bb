"""What a job asks of the database, so that nobody adds to it unawares: every job of every kind pays it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import event

from service.db.session import Database
from service.jobs.claims import Lease, claim, finishing
from tests.service.jobs.support import Postbox, make_calibration, make_fleet, make_jobs


@contextmanager
def statements(database: Database) -> Iterator[list[str]]:
    seen: list[str] = []

    def note(connection: object, cursor: object, statement: str, *_: object) -> None:
        seen.append(statement)

    event.listen(database.engine, "before_cursor_execute", note)
    yield seen
    event.remove(database.engine, "before_cursor_execute", note)


def test_a_claim_is_one_statement_and_a_finish_three(database: Database):
    postbox = Postbox(database)
    _, (run_id,) = make_calibration(database)
    job_id, *_ = make_jobs(database, make_fleet(database, "other"), 5, run_id)
    before = list(postbox.ids)
    with statements(database) as seen:
        held = claim(database, job_id, "worker")
        assert held
        with Lease(database, held), finishing(database, held):
            pass
    verbs = [statement.split()[0] for statement in seen if not statement.startswith("BEGIN")]
    # The claim; the gate, the history, the next release.
    assert verbs == ["UPDATE", "UPDATE", "INSERT", "WITH"]
    assert len(postbox.ids) == len(before) + 1
