"""Rows that the job tests start from."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from uuid import UUID

from sqlalchemy import event, select, update

from service.platform.db.clock import now
from service.platform.db.models import Calibration, CalibrationRun, CorrespondenceSet, Fleet, Job, Rig, Vehicle
from service.platform.db.session import Database
from service.platform.jobs.messages import COURIER, Message
from service.platform.jobs.queue import enqueue_all
from service.platform.jobs.reaper import _end_backoff, _release_waiting
from tests.support.rows import add


class Postbox:
    """A courier that keeps what it was given."""

    def __init__(self, database: Database) -> None:
        self.sent: list[Message] = []
        database.couriers[COURIER] = self.sent.extend

    @property
    def ids(self) -> list[int]:
        return [message.job_id for message in self.sent]


def make_fleet(database: Database, name: str = "fleet") -> UUID:
    with database.writing() as session:
        return add(session, Fleet, name=name).id


def make_calibration(database: Database, *, models: Iterable[str] = ("pinhole",), slots: int = 2, bundle: int = 1):
    """A calibration whose runs have not been started; returns (calibration id, run ids)."""
    with database.writing() as session:
        rig = add(session, Rig, add(session, Vehicle, add(session, Fleet, name="fleet")))
        places = {name: [float(2 + n % 7) for n in range(60)] for name in "xyzuv"}
        pairs, models = add(session, CorrespondenceSet, rig, count=60, pairs=places), list(models)
        calibration = add(session, Calibration, rig, remaining=len(models), state="queued")
        cut = {"slots": slots, "bundle": bundle}
        runs = [add(session, CalibrationRun, calibration, pairs, model=model, **cut) for model in models]
        return calibration.id, [run.id for run in runs]


def make_jobs(
    database: Database, fleet_id: UUID, count: int, run_id: UUID | None = None, *, kind: str = "solve"
) -> list[int]:
    with database.writing() as session:
        jobs = enqueue_all(
            session,
            kind=kind,
            fleet_id=fleet_id,
            subject_id=run_id or fleet_id,
            payloads=[{"number": number} for number in range(count)],
        )
        return [job.id for job in jobs]


def job(database: Database, job_id: int) -> Job:
    with database.reading() as session:
        return session.get_one(Job, job_id)


def states(database: Database) -> list[str]:
    with database.reading() as session:
        return list(session.scalars(select(Job.state).order_by(Job.id)))


def make_due(database: Database) -> None:
    """As if every moment to send again had come."""
    with database.writing() as session:
        session.execute(update(Job).where(Job.send_after.is_not(None)).values(send_after=now(-1)))


def let_backoff_end(database: Database) -> None:
    """As if every moment to try again had come, and a sweep."""
    make_due(database)
    with database.writing() as session:
        _end_backoff(session)
    _release_waiting(database)


@contextmanager
def statements(database: Database) -> Iterator[list[str]]:
    """The first words of the statements that reach the database meanwhile.

    Without the beginning of transactions, and without a lease's looks, whose number is that of the seconds passed.
    """
    seen: list[str] = []

    def note(connection: object, cursor: object, statement: str, *_: object) -> None:
        if not (statement.startswith("BEGIN") or threading.current_thread().name.startswith("lease-")):
            seen.append(statement.split()[0])

    event.listen(database.engine, "before_cursor_execute", note)
    yield seen
    event.remove(database.engine, "before_cursor_execute", note)
