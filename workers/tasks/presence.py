"""A worker's row while it lives: that it answers, which queues it takes, whether its kernels are compiled."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from importlib.metadata import version
from typing import Any

from sqlalchemy import Connection, delete
from sqlalchemy.exc import SQLAlchemyError

from service.platform.db.clock import now
from service.platform.db.jobs import Worker
from service.platform.db.session import Database, put
from service.platform.settings import get_settings
from workers import transport
from workers.alive import meanwhile

BEAT_S = 2.0

log = logging.getLogger(__name__)


class Presence:
    """Written by the worker's parent, each time in one statement.

    Pool processes are forked beside its connection to PostgreSQL, which they inherit and never touch: psycopg leaves
    what another process opened alone. SQLite forbids that, so its file is opened each time.

    A worker whose row cannot be written takes no messages until it can: it could not claim their jobs.
    """

    def __init__(self, name: str, queues: str, processes: int) -> None:
        self._name = name[:200]
        self._about = {"queues": queues[:200], "processes": processes, "version": version("apexcal")}
        self.queues = tuple(queues.split(","))
        self._timer: Any = None
        self._database: Database | None = None

    @classmethod
    def of(cls, worker: Any) -> Presence:
        """The presence of a Celery worker; its process id too, for two on one host may share a name for a while."""
        queues = ",".join(sorted(worker.app.amqp.queues.consume_from))
        return cls(f"{worker.hostname}:{os.getpid()}", queues, worker.concurrency or 1)

    def say(self, *, warm: bool) -> None:
        """Write that the worker lives. If the database does not answer at once, the next call is soon enough."""
        first = self._about | {"started_at": now()}
        self._write(
            lambda connection: put(connection, Worker, {"name": self._name}, {"at": now(), "warm": warm}, first=first)
        )

    def said_meanwhile(self) -> AbstractContextManager[None]:
        """Say that it lives, and compiles, until the block ends."""
        return meanwhile(partial(self.say, warm=False), BEAT_S)

    def keep_saying(self, timer: Any) -> None:
        """Say it every few seconds from Celery's timer, which stands still while the broker is away."""
        if self._timer is not None:
            self._timer.cancel()
        self.say(warm=True)
        self._timer = timer.call_repeatedly(BEAT_S, self.say, kwargs={"warm": True})

    def end(self) -> None:
        """Take the row away."""
        self._write(lambda connection: connection.execute(delete(Worker).where(Worker.name == self._name)))
        self._disconnect()

    def _write(self, write: Callable[[Connection], object]) -> None:
        if self._database is None:
            self._database = Database(get_settings().database, connections=1)
        try:
            with self._database.alone() as connection:
                write(connection)
            transport.PAUSE.clear()
            is_kept = self._database.engine.dialect.name != "sqlite"
        except SQLAlchemyError as error:
            transport.PAUSE.set()
            log.warning("could not say that this worker lives: %s", type(error).__name__)
            is_kept = False
        if not is_kept:
            self._disconnect()

    def _disconnect(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None
