"""What a job asks of the database, so that nobody adds to it unawares: every job of every kind pays it."""

from __future__ import annotations

from service.platform.db.session import Database
from service.platform.jobs.claims import Lease, claim, finishing
from tests.service.platform.jobs.support import Postbox, make_calibration, make_fleet, make_jobs, statements


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
    # The claim; the gate, the history, the next release.
    assert seen == ["UPDATE", "UPDATE", "INSERT", "WITH"]
    assert len(postbox.ids) == len(before) + 1
