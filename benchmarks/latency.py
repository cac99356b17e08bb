"""`python -m benchmarks.latency`: how long one person waits for one calibration, by how its runs are cut into jobs.

The service with one and with two pool processes, idle, does the same requests again and again: farmed by whole runs,
by single slots, and as `auto` decides. More processes are not measured but replayed: the jobs of the one process,
each with its recorded duration and the mean pause between two jobs, go to the first free process, in the queue's
order and not before what they wait for. ROUNDS: of each (5). The last line is JSON, seconds.
"""

from __future__ import annotations

import heapq
import json
import os
import secrets
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple
from uuid import UUID

import numpy as np
from sqlalchemy import Select, select

from benchmarks.accuracy.rigs import draw_rig
from benchmarks.asker import Asker
from benchmarks.house import House, percentile
from service.platform.db.calibrations import CalibrationRun
from service.platform.db.jobs import Job

MEASURED: Final = (1, 2)
REPLAYED: Final = (1, 2, 4, 8, 16, 32, 100)
ASKED: Final[dict[str, dict[str, Any]]] = {
    "default": {},
    "default, one fit": {"models": ["brown_conrady"], "folds": 0},
    "paper, one fit": {"models": ["brown_conrady"], "folds": 0, "preset": "paper"},
    "toolbox, one fit": {"models": ["brown_conrady"], "folds": 0, "preset": "toolbox"},
}
FARMS: Final = ("runs", "slots", "auto")
_FINISH: Final = 10**6  # after all iterations


class DoneJob(NamedTuple):
    """A job as one process did it. run: of which; stage: its jobs wait for all of the stage before."""

    run: UUID
    stage: int
    seconds: float


class Waited(NamedTuple):
    """One calibration: seconds from the request to its end, and its jobs in the order of their starts."""

    seconds: float
    jobs: list[DoneJob]

    @property
    def pause_s(self) -> float:
        """The mean time of a job that is not its work, of one process."""
        return (self.seconds - sum(job.seconds for job in self.jobs)) / len(self.jobs)


def waited(house: House, asker: Asker) -> Waited:
    """Ask once."""
    seconds, calibration = asker.ask()
    with house.database.reading() as session:
        rows = session.execute(_jobs_of(calibration)).all()
    jobs = [
        DoneJob(row.subject_id, _stage(row.payload), (row.finished_at - row.started_at).total_seconds())
        for row in rows
    ]
    return Waited(seconds, jobs)


def _stage(payload: Mapping[str, Any]) -> int:
    return _FINISH if payload["part"] == "finish" else payload.get("iteration", 0)


def _jobs_of(calibration: UUID) -> Select[Any]:
    runs = select(CalibrationRun.id).where(CalibrationRun.calibration_id == calibration)
    columns = (Job.subject_id, Job.payload, Job.started_at, Job.finished_at)
    return select(*columns).where(Job.subject_id.in_(runs)).order_by(Job.started_at)


def replayed(jobs: Sequence[DoneJob], pause_s: float, processes: int) -> float:
    """Seconds until the last of the jobs ends on so many processes."""
    stages: dict[UUID, list[list[float]]] = {}
    for run in dict.fromkeys(job.run for job in jobs):
        numbers = sorted({job.stage for job in jobs if job.run == run})
        stages[run] = [[job.seconds for job in jobs if (job.run, job.stage) == (run, each)] for each in numbers]
    free = [0.0] * processes
    # When a stage's jobs are ready, which of them come first, and whose they are.
    ready = [(0.0, order, run, 0) for order, run in enumerate(stages)]
    end_s = 0.0
    while ready:
        at_s, order, run, stage = heapq.heappop(ready)
        ends: list[float] = []
        for seconds in stages[run][stage]:
            ends.append(max(heapq.heappop(free), at_s) + pause_s + seconds)
            heapq.heappush(free, ends[-1])
        end_s = max(end_s, *ends)
        if stage + 1 < len(stages[run]):
            heapq.heappush(ready, (max(ends), order, run, stage + 1))
    return end_s


def measure(rounds: int, seed: int) -> dict[str, dict[str, Any]]:
    """By request and farming: measured seconds (median, 0.1 and 0.9 quantile) and replayed ones, by processes."""
    figures: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory(prefix="apexcal-latency-") as folder:
        house = House(Path(folder) / "data", MEASURED[0])
        try:
            rig = draw_rig("brown_conrady", np.random.default_rng([seed, 1]))
            askers = {
                f"{name}, {farm}": Asker(house, rig, {**asked, "farm": farm}, f"{name}, {farm}")
                for name, asked in ASKED.items()
                for farm in FARMS
            }
            for processes in MEASURED:
                house.restart_worker(processes)
                for name, asker in askers.items():
                    asker.ask()
                    all_waited = [waited(house, asker) for _ in range(rounds)]
                    seconds = [each.seconds for each in all_waited]
                    figure = figures.setdefault(name, {"jobs": len(all_waited[0].jobs)})
                    figure[f"measured_{processes}"] = [
                        round(value, 3)
                        for value in (median(seconds), percentile(seconds, 0.1), percentile(seconds, 0.9))
                    ]
                    if processes == 1:
                        middle = sorted(all_waited, key=lambda each: each.seconds)[rounds // 2]
                        figure["replayed"] = {
                            count: round(replayed(middle.jobs, middle.pause_s, count), 3) for count in REPLAYED
                        }
                    print(name, processes, figure, file=sys.stderr, flush=True)
        finally:
            house.close()
    return figures


def main() -> None:
    rounds, seed = int(os.environ.get("ROUNDS", "5")), int(os.environ.get("SEED") or secrets.randbits(31))
    print(json.dumps({"seed": seed, "rounds": rounds, **measure(rounds, seed)}))


if __name__ == "__main__":
    main()
