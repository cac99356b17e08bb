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
from service.platform.jobs.sweep import _end_backoff, _release_waiting


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
        fleet = Fleet(name=name)
        session.add(fleet)
        session.flush()
        return fleet.id


def make_calibration(database: Database, *, models: Iterable[str] = ("pinhole",), slots: int = 2, bundle: int = 1):
    """A calibration whose runs have not been started; returns (calibration id, run ids)."""
    with database.writing() as session:
        fleet = Fleet(name="fleet")
        session.add(fleet)
        session.flush()
        vehicle = Vehicle(fleet_id=fleet.id, name="car")
        session.add(vehicle)
        session.flush()
        rig = Rig(fleet_id=fleet.id, vehicle_id=vehicle.id, name="roof", lidar_frame="velodyne")
        session.add(rig)
        session.flush()
        common = {"fleet_id": fleet.id, "vehicle_id": vehicle.id, "rig_id": rig.id}
        places = {name: [float(2 + n % 7) for n in range(60)] for name in "xyzuv"}
        pairs = CorrespondenceSet(**common, camera="front", source="import", content_hash="0", count=60, pairs=places)
        models = list(models)
        calibration = Calibration(
            **common, request={}, content_hash="0", remaining=len(models), publish="none", state="queued"
        )
        session.add_all([pairs, calibration])
        session.flush()
        runs = [
            CalibrationRun(
                fleet_id=fleet.id,
                calibration_id=calibration.id,
                set_id=pairs.id,
                camera="front",
                model=model,
                fold=-1,
                farm="slots",
                slots=slots,
                bundle=bundle,
                problem={},
            )
            for model in models
        ]
        session.add_all(runs)
        session.flush()
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
        _release_waiting(session)


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
