"""`python -m benchmarks.farm`: what the queue costs a job with almost nothing to do. SHORT=1 for a short form.

On both databases, each syncing every commit: wall milliseconds of two pool processes and processor milliseconds of
all processes, medians of some rounds of 300 jobs. The last line is JSON.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal
from uuid import UUID

import numpy as np
from sqlalchemy import select

from benchmarks.accuracy.rigs import draw_rig
from benchmarks.asker import Asker
from benchmarks.house import House
from service.platform.db.calibrations import CalibrationRun
from service.platform.db.jobs import Job

# 64 x 1 on 222 pairs: a tenth of a millisecond of work, whose end no slot polishes. The run's last job does more, so
# there are many slots.
_TRIPS: dict[str, Any] = {
    "models": ["brown_conrady"],
    "folds": 0,
    "farm": "slots",
    "preset": "toolbox",
    "schedule": {"slots": 100, "population": 64, "generations": 1, "max_iterations": 3, "patience": 1000},
}


def trips(house: House, rounds: int, seed: int) -> dict[str, float]:
    """Wall and processor milliseconds of each slot's job, with two pool processes."""
    asker = Asker(house, draw_rig("brown_conrady", np.random.default_rng([seed, 1])), _TRIPS)
    asker.ask()
    rows: list[tuple[float, float]] = []
    for _ in range(rounds):
        cpu_s = sum(house.cpu_s().values())
        _, calibration = asker.ask()
        cpu_s = sum(house.cpu_s().values()) - cpu_s
        count, span_s = _jobs(house, calibration)
        rows.append((1e3 * span_s / count, 1e3 * cpu_s / count))
        print(f"{count} trips of {rows[-1][0]:.2f} ms, {rows[-1][1]:.2f} ms of cpu", file=sys.stderr)
    ms, cpu_ms = np.median(rows, axis=0).tolist()
    return {"ms": ms, "cpu_ms": cpu_ms}


def _jobs(house: House, calibration: UUID) -> tuple[int, float]:
    """How many slots' jobs there were, and the seconds from the first one's claim to the last one's finish."""
    runs = select(CalibrationRun.id).where(CalibrationRun.calibration_id == calibration)
    asked = select(Job.payload, Job.started_at, Job.finished_at).where(Job.subject_id.in_(runs))
    with house.database.reading() as session:
        rows = [row for row in session.execute(asked) if row.payload["part"] == "slots"]
    span = max(row.finished_at for row in rows) - min(row.started_at for row in rows)
    return len(rows), span.total_seconds()


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
