"""Every transaction locks rows in the one order that the tree of work states, whatever is asked of it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from uuid import UUID

import pytest
from sqlalchemy import Engine, event, select

from service.platform.db.models import (
    Calibration,
    CorrespondenceSet,
    Detection,
    Fleet,
    FleetRequestVehicle,
    Recording,
    Rig,
    Sensor,
)
from service.platform.jobs.claims import claim, finishing
from service.platform.jobs.queue import enqueue, retry
from service.platform.jobs.reaper import reap
from service.platform.jobs.tree import LOCK_ORDER
from service.recordings.actions import delete_recording
from service.recordings.jobs import queue_ingestion
from tests.service.detections.seeding import seed_recording
from tests.support.rows import add
from tests.support.work import lose_every_worker, work
from workers.tasks.running import run_job

from .conftest import QUICK, Vans
from .test_progress import job_of

_UPDATE = re.compile(r"\bUPDATE (\w+) SET\b")
_LOCK = re.compile(r"\bFROM (\w+)\b.*\bFOR (?:NO KEY UPDATE|UPDATE|SHARE|KEY SHARE)\b", re.DOTALL)


def locked(statement: str) -> str | None:
    """The table whose rows a statement waits for. Who skips locked rows waits for none."""
    found = _UPDATE.search(statement) or _LOCK.search(statement)
    if found is None or "SKIP LOCKED" in statement:
        return None
    is_end = statement.startswith("UPDATE") and "calibration_id IN" in statement
    return "idle vehicle" if found[1] == "fleet_request_vehicle" and not is_end else found[1]


@contextmanager
def transactions() -> Iterator[list[list[str]]]:
    """The tables that each transaction locks meanwhile, in the order in which it does so first."""
    begun: list[list[str]] = []
    running: dict[object, list[str]] = {}

    def begin(connection) -> None:
        running[connection.connection.dbapi_connection] = tables = []
        begun.append(tables)

    def note(connection, cursor, statement, *_) -> None:
        tables, table = running.get(connection.connection.dbapi_connection, []), locked(statement)
        if table is not None and table not in tables:
            tables.append(table)

    event.listen(Engine, "begin", begin)
    event.listen(Engine, "before_cursor_execute", note)
    try:
        yield begun
    finally:
        event.remove(Engine, "begin", begin)
        event.remove(Engine, "before_cursor_execute", note)


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_every_transaction_locks_in_the_order_of_the_tree(vans: Vans, context):
    """SQLite has one writer, and no statement says there what it locks."""
    made = [vans.add(f"van {n}", 200) for n in range(5)]
    with transactions() as seen:
        calibration = QUICK | {"publish": "recommended", "folds": 2, "farm": "slots"}
        asked = vans.ask(calibration=calibration).json()
        run_job(context, job_of(context, made[0]))
        lose_every_worker(context.database, job_of(context, made[1]))
        reap(context.database, context.store)
        vans.engineer.post(f"/fleet-requests/{asked['id']}/cancel")
        reap(context.database, context.store)
        work(context)
        vans.engineer.post(f"/fleet-requests/{asked['id']}/retry")
        work(context)
        _ask_alone(vans, context, made[2])
        _end_detections(vans, context, made[3])
        _delete_pairs(vans, context, made[4])
    orders = [[table for table in tables if table in (*LOCK_ORDER, "idle vehicle")] for tables in seen]
    for tables in orders:
        tree = [table for table in tables if table != "idle vehicle"]
        assert tree == sorted(tree, key=LOCK_ORDER.index), tables
        assert "idle vehicle" not in tables or not set(tables[: tables.index("idle vehicle")]) & {*LOCK_ORDER[4:]}
    together = {table for tables in orders if len(tables) > 1 for table in tables}
    assert together == {*LOCK_ORDER, "idle vehicle"}, "each table beside others"


def _ask_alone(vans: Vans, context, van) -> None:
    """A calibration of its own: its run fails, is retried, and cancelled."""
    body = {"correspondence_set_ids": [van["set"]], **QUICK}
    alone = vans.engineer.post(f"/vehicles/{van['vehicle']}/calibrations", body).json()
    job_id = job_of(context, van)
    lose_every_worker(context.database, job_id)
    reap(context.database, context.store)
    with context.database.writing() as session:
        retry(session, job_id)
    vans.engineer.post(f"/calibrations/{alone['id']}/cancel")
    reap(context.database, context.store)


def _end_detections(vans: Vans, context, van) -> None:
    """A recording and a detection: each fails, is retried, and is done."""
    with context.database.reading() as session:
        rig = session.get_one(Rig, UUID(van["rig"]))
    recording_id, _ = seed_recording(context.database, rig, 3)
    with context.database.writing() as session:
        job = queue_ingestion(session, session.get_one(Recording, recording_id, with_for_update=True))
    with finishing(context.database, claim(context.database, job.id, "w"), "failed", {"code": "x"}):
        pass
    with context.database.writing() as session:
        (again,) = retry(session, job.id)
    with finishing(context.database, claim(context.database, again.id, "w")):
        pass
    with context.database.writing() as session:
        recording = session.get_one(Recording, recording_id)
        lidar = session.query(Sensor).filter_by(recording_id=recording_id, kind="lidar").one()
        row = add(session, Detection, recording, lidar, state="queued", remaining=1)
        job = enqueue(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id)
    lose_every_worker(context.database, job.id)
    reap(context.database, context.store)
    with context.database.writing() as session:
        (again,) = retry(session, job.id)
    with finishing(context.database, claim(context.database, again.id, "w")) as session:
        session.execute(select(Recording.id).where(Recording.id == recording_id).with_for_update())


def _delete_pairs(vans: Vans, context, van) -> None:
    """A recording is deleted with the pairs of a request's vehicles, one of which failed and one waits."""
    with context.database.reading() as session:
        rig = session.get_one(Rig, UUID(van["rig"]))
    recording_id, _ = seed_recording(context.database, rig, 3)
    with context.database.writing() as session:
        session.get_one(CorrespondenceSet, UUID(van["set"])).recording_id = recording_id
    vans.ask({"name": "van 4"})
    with context.database.writing() as session:
        delete_recording(session, recording_id, with_published=True)
    with context.database.reading() as session:
        assert session.scalars(select(Calibration).where(Calibration.vehicle_id == rig.vehicle_id)).all() == []
        assert session.scalars(select(Fleet)).all() and session.scalars(select(FleetRequestVehicle)).all()
