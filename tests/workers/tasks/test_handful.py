"""Jobs that a process goes on with without a message of their own."""

from __future__ import annotations

from uuid import uuid4

import pytest

from service.platform.db.session import post
from service.platform.jobs.messages import COURIER, Message
from tests.service.platform.jobs.support import job, make_fleet, make_jobs, states
from workers.tasks import handful
from workers.tasks.handful import Handful
from workers.tasks.running import WORK, run_jobs


@pytest.fixture
def sent(context, monkeypatch):
    """The messages that go to the broker; jobs of the queue `solve` have nothing to do."""
    messages: list[Message] = []
    context.send = context.database.couriers[COURIER] = Handful(messages.extend)
    monkeypatch.setitem(WORK, "solve", lambda *_: lambda session: None)
    return messages


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_message_is_enough_for_the_jobs_that_follow_within_its_time(context, database, sent, monkeypatch, goes_on):
    monkeypatch.setattr(handful, "HANDFUL_S", 600.0 if goes_on else 0.0)
    # Two are sent when they are made; each end releases one.
    first, second, third, *_ = make_jobs(database, make_fleet(database), 5, uuid4())
    assert run_jobs(context, Message(first, "solve")) is None
    assert states(database).count("done") == (4 if goes_on else 1)
    assert [message.job_id for message in sent] == ([] if goes_on else [third])
    assert job(database, second).state == "queued", "it has a message of its own"


def test_a_job_for_other_workers_and_one_that_fails(context, database, sent, monkeypatch):
    monkeypatch.setattr(handful, "HANDFUL_S", 600.0)
    fleet_id = make_fleet(database)
    other = make_jobs(database, fleet_id, 1, uuid4(), kind="report")[0]

    def ends(*_):
        def write(session):
            post(session, COURIER, Message(other, "report"))

        return write

    monkeypatch.setitem(WORK, "solve", ends)
    first, *_ = make_jobs(database, fleet_id, 1, uuid4())
    run_jobs(context, Message(first, "solve"))
    assert sent == [Message(other, "report")] and job(database, other).state == "queued"

    def defect(*_):
        raise ValueError

    first, _, third = make_jobs(database, fleet_id, 3, uuid4())
    monkeypatch.setitem(WORK, "solve", defect)
    assert run_jobs(context, Message(first, "solve")) == "internal_error"
    assert job(database, third).state == "failed"
