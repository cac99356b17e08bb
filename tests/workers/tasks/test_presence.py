"""A worker's row: renewed while it compiles; without it the worker takes no messages."""

import gc
import os

import pytest
from sqlalchemy import event, select
from sqlalchemy.engine import Engine

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
    presence.end()


def test_a_worker_that_cannot_say_so_takes_no_messages(context, database, monkeypatch):
    presence = Presence("worker@here:1", "solve", 2)
    presence.say(warm=True)
    assert not transport.PAUSE.is_set()
    presence.end()
    with monkeypatch.context() as away:
        settings = presence_module.get_settings().model_copy(update={"database_url": "sqlite:////no/folder/x.db"})
        away.setattr(presence_module, "get_settings", lambda: settings)
        presence.say(warm=True)
    assert transport.PAUSE.is_set() and not transport.QoS.can_consume(object.__new__(transport.QoS))
    presence.say(warm=True)
    assert not transport.PAUSE.is_set()
    presence.end()


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_each_sign_of_life_is_one_statement_on_the_same_connection(context, database, monkeypatch):
    statements, connections = [], set()

    def note(connection, cursor, statement, *_: object) -> None:
        if statement.lower().startswith(("insert", "delete", "select", "show", "begin")):
            statements.append(statement.partition(" ")[0])
        connections.add(cursor.connection.info.backend_pid)

    presence = Presence("worker@here:1", "solve", 2)
    presence.say(warm=False)
    event.listen(Engine, "before_cursor_execute", note)
    try:
        for _ in range(3):
            presence.say(warm=True)
        child = os.fork()
        if child == 0:  # as a pool process: it ends without touching anything
            gc.collect()
            os._exit(0)
        os.waitpid(child, 0)
        presence.say(warm=True)
        presence.end()
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    assert (statements, len(connections)) == (["INSERT"] * 4 + ["DELETE"], 1)
    assert presence._database is None
