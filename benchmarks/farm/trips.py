"""What one job costs beside its work: trips of slots with almost nothing to do."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import median
from typing import Any
from uuid import UUID

import numpy as np
from sqlalchemy import event, func, select

from benchmarks.accuracy.rigs import draw_rig
from benchmarks.farm.asking import Asker
from benchmarks.house import House
from service.platform.db.calibrations import CalibrationRun
from service.platform.db.jobs import Job
from service.platform.settings import Settings
from workers.solver.slot import warm_up
from workers.tasks.context import Context
from workers.tasks.running import run_job

# 64 x 1 on 222 pairs: a tenth of a millisecond of work. The run's last job does more, so there are many slots.
_TRIPS: dict[str, Any] = {
    "models": ["brown_conrady"],
    "folds": 0,
    "farm": "slots",
    "schedule": {"slots": 100, "population": 64, "generations": 1, "max_iterations": 3, "patience": 1000},
}
_COUNTED = 20
_IDLE_S = 4.0


def trips(house: House, rounds: int, seed: int) -> dict[str, float]:
    """Milliseconds of the machine for each job, with two pool processes; broker commands and statements of one."""
    asker = Asker(house, "trips", draw_rig("brown_conrady", np.random.default_rng([seed, 1])))
    asker.ask(**_TRIPS)
    idle = _idle_calls_per_s(house)
    found = [_round(house, asker, idle) for _ in range(rounds)]
    ms, cpu_ms, calls = (median(column) for column in zip(*found, strict=True))
    return {"ms": ms, "cpu_ms": cpu_ms, "broker_commands": calls, "sql_statements": _statements(house, asker)}


def _idle_calls_per_s(house: House) -> float:
    """Commands that waiting workers send for themselves."""
    before = house.broker_calls()
    time.sleep(_IDLE_S)
    return (house.broker_calls() - before) / _IDLE_S


def _round(house: House, asker: Asker, idle_calls_per_s: float) -> tuple[float, float, float]:
    """Wall and processor milliseconds and broker commands of each slot's job of one run."""
    cpu, calls = sum(house.cpu_s().values()), house.broker_calls()
    seconds, (calibration,) = asker.ask(**_TRIPS)
    cpu = sum(house.cpu_s().values()) - cpu
    calls = house.broker_calls() - calls - seconds * idle_calls_per_s
    count, span_s = _jobs(house, calibration)
    print(f"{count} trips of {1e3 * span_s / count:.2f} ms, {1e3 * cpu / count:.2f} ms of cpu", file=sys.stderr)
    return 1e3 * span_s / count, 1e3 * cpu / count, calls / count


def _jobs(house: House, calibration: UUID) -> tuple[int, float]:
    """How many slots' jobs there were, and the seconds from the first one's claim to the last one's finish."""
    runs = select(CalibrationRun.id).where(CalibrationRun.calibration_id == calibration)
    asked = select(Job.payload, Job.started_at, Job.finished_at).where(Job.subject_id.in_(runs))
    with house.database.reading() as session:
        rows = [row for row in session.execute(asked) if row.payload["part"] == "slots"]
    span = max(row.finished_at for row in rows) - min(row.started_at for row in rows)
    return len(rows), span.total_seconds()


def _statements(house: House, asker: Asker) -> float:
    """Statements that reach the database for one job, each `BEGIN`, `COMMIT` and look whether it answers included.

    Done by this process as a pool process does it, and counted by the database itself.
    """
    warm_up()
    house.restart_worker(0)
    calibration = asker.begin(**_TRIPS)
    counter = _PostgresCounter(house) if house.postgres else _SqliteCounter(house)
    runs = select(CalibrationRun.id).where(CalibrationRun.calibration_id == calibration)
    try:
        with house.database.reading() as session:
            ids = session.scalars(select(Job.id).where(Job.subject_id.in_(runs)).order_by(Job.id)).all()
        counts: list[int] = []
        # The first ones connect and prepare.
        for job_id in ids[: 2 * _COUNTED]:
            before = counter.count()
            run_job(counter.context, job_id)
            counts.append(counter.count() - before)
        with house.database.reading() as session:
            done = select(func.count()).where(Job.id.in_(ids), Job.state == "done")
            assert session.scalar(done) == 2 * _COUNTED
    finally:
        counter.context.database.close()
        house.restart_worker(2)
    asker.wait([calibration])
    return median(counts[_COUNTED:])


class _PostgresCounter:
    """The server logs every statement of these connections."""

    def __init__(self, house: House) -> None:
        assert house.postgres
        self._log: Path = house.postgres.folder / "log"
        self.context = _context(house, f"{house.url}&options=-c%20log_statement%3Dall")

    def count(self) -> int:
        return sum("LOG:  statement: " in line or "LOG:  execute " in line for line in self._log.open())


class _SqliteCounter:
    """SQLite calls back for every statement that it runs."""

    def __init__(self, house: House) -> None:
        self.context = _context(house, house.url)
        self._seen: list[str] = []
        event.listen(self.context.database.engine, "connect", self._watch)

    def _watch(self, connection: Any, record: object) -> None:
        connection.set_trace_callback(self._note)

    def _note(self, statement: str) -> None:
        # A setting of the connection itself, not of the database.
        if not statement.startswith("PRAGMA"):
            self._seen.append(statement)

    def count(self) -> int:
        return len(self._seen)


def _context(house: House, url: str) -> Context:
    return Context(
        Settings(data_dir=house.folder.root, database_url=url, broker_url=house.broker_url, min_free_bytes=0)
    )
