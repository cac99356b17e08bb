"""`python -m benchmarks.farm`: what the queue costs a job with almost nothing to do. SHORT=1 for a short form.

On both databases, each syncing every commit: wall milliseconds of two pool processes, processor milliseconds of all
processes and broker commands, medians of some rounds of 300 jobs. The last line is JSON.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any, Literal
from uuid import UUID

import numpy as np
from sqlalchemy import select

from benchmarks.accuracy.rigs import Rig, draw_rig
from benchmarks.fleet.vehicles import bring
from benchmarks.house import House
from service.platform.db.calibrations import Calibration, CalibrationRun
from service.platform.db.jobs import Job

# 64 x 1 on 222 pairs: a tenth of a millisecond of work. The run's last job does more, so there are many slots.
_TRIPS: dict[str, Any] = {
    "models": ["brown_conrady"],
    "folds": 0,
    "farm": "slots",
    "schedule": {"slots": 100, "population": 64, "generations": 1, "max_iterations": 3, "patience": 1000},
}
_IDLE_S = 4.0


def trips(house: House, rounds: int, seed: int) -> dict[str, float]:
    """Milliseconds of the machine for each job, with two pool processes, and its broker commands."""
    asker = Asker(house, draw_rig("brown_conrady", np.random.default_rng([seed, 1])))
    asker.ask()
    idle = _idle_calls_per_s(house)
    found = [_round(house, asker, idle) for _ in range(rounds)]
    ms, cpu_ms, calls = (median(column) for column in zip(*found, strict=True))
    return {"ms": ms, "cpu_ms": cpu_ms, "broker_commands": calls}


def _idle_calls_per_s(house: House) -> float:
    """Commands that waiting workers send for themselves."""
    before = house.broker_calls()
    time.sleep(_IDLE_S)
    return (house.broker_calls() - before) / _IDLE_S


def _round(house: House, asker: Asker, idle_calls_per_s: float) -> tuple[float, float, float]:
    """Wall and processor milliseconds and broker commands of each slot's job of one run."""
    cpu, calls = sum(house.cpu_s().values()), house.broker_calls()
    seconds, calibration = asker.ask()
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


# A hint may be lost.
_LOOK_S = 0.5


class Asker:
    """One vehicle of a fleet of its own, and its pairs."""

    def __init__(self, house: House, rig: Rig) -> None:
        self._house, client = house, house.client
        self._fleet = client.fleets.create("trips").id
        (self._vehicle,) = bring(client, self._fleet, [rig])
        (described,) = client.vehicles.rigs(self._vehicle)
        (pairs,) = client.correspondence_sets.list(described.id)
        self._pairs = pairs.id

    def ask(self) -> tuple[float, UUID]:
        """Ask for a calibration; the seconds until it has ended, and its id."""
        with self._house.changes(self._fleet) as change:
            began = time.perf_counter()
            id = self._house.client.calibrations.create(self._vehicle, [self._pairs], **_TRIPS).id
            # Neither the API nor the database is asked over and over: that would cost the farm its own cores.
            while (state := self._state(id)) in ("queued", "running"):
                change(_LOOK_S)
            assert state == "done", state
            return time.perf_counter() - began, id

    def _state(self, id: UUID) -> str:
        with self._house.database.reading() as session:
            return session.scalars(select(Calibration.state).where(Calibration.id == id)).one()


def measure(database: Literal["postgresql", "sqlite"], rounds: int, seed: int) -> dict[str, float]:
    """The figures of one database."""
    with tempfile.TemporaryDirectory(prefix="apexcal-farm-") as folder:
        house = House(Path(folder) / "data", 2, database)
        try:
            return {name: round(value, 3) for name, value in trips(house, rounds, seed).items()}
        finally:
            house.close()


def main() -> None:
    rounds, seed = 3 if os.environ.get("SHORT") else 9, int(os.environ.get("SEED") or secrets.randbits(31))
    figures = {database: measure(database, rounds, seed) for database in ("postgresql", "sqlite")}
    print(json.dumps({"seed": seed, **figures}))


if __name__ == "__main__":
    main()
