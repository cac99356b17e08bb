"""A worker's row: renewed while it compiles; without it the worker takes no messages."""

from sqlalchemy import select

from service.platform.db.jobs import Worker
from tests.support.processes import wait_until
from workers import transport
from workers.tasks import presence as presence_module
from workers.tasks.presence import Presence


def test_it_is_renewed_while_the_worker_compiles(context, database, monkeypatch):
    monkeypatch.setattr(presence_module, "BEAT_S", 0.02)

    def row() -> Worker:
        with database.reading() as session:
            return session.scalars(select(Worker)).one()

    presence = Presence("worker@here:1", "solve", 2)
    with presence.said_meanwhile():
        first = row()
        wait_until(lambda: row().at > first.at, "another sign of life")
    assert (row().warm, row().started_at, row().queues) == (False, first.started_at, "solve")
    presence.say(warm=True)
    assert row().warm


def test_a_worker_that_cannot_say_so_takes_no_messages(context, database, monkeypatch):
    presence = Presence("worker@here:1", "solve", 2)
    presence.say(warm=True)
    assert not transport.PAUSE.is_set()
    with monkeypatch.context() as away:
        settings = presence_module.get_settings().model_copy(update={"database_url": "sqlite:////no/folder/x.db"})
        away.setattr(presence_module, "get_settings", lambda: settings)
        presence.say(warm=True)
    assert transport.PAUSE.is_set() and not transport.QoS.can_consume(object.__new__(transport.QoS))
    presence.say(warm=True)
    assert not transport.PAUSE.is_set()
