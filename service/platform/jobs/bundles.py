"""Cuts solver work into jobs, by its cost and by that of a trip through the queue.

The cut never changes a result, only how long it takes.

Costs are seconds of one processor, predicted before the work is done: they also refuse what would never end. The
search counts with all the iterations that its schedule allows; most end after a third of them.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

from apexcal.documents.camera_models import CAMERA_MODELS, ModelName
from apexcal.documents.schedules import Schedule

# Cost around the kernel: preparing its input (0.07 ms measured) and storing its best.
SLOT_MS = 0.2
# The end of a run: polish, outliers, baselines, uncertainty; and what the model takes of each pair.
FINISH_MS = 100.0
# And a sentence about each outlier, which looks at all pairs: 17 ns measured; half of the pairs may be outliers.
OUTLIER_PAIR_NS = 8.5
# Comparing two cameras' marks of the same vertex: 1.7-2.3 microseconds measured, without the keys.
SHARED_PAIR_US = 10.0


class RunCost(NamedTuple):
    """One fit: seconds of a slot and of the end, and the most slots that all its iterations run."""

    slot_s: float
    slots: int
    finish_s: float

    @property
    def seconds(self) -> float:
        """The whole run."""
        return self.slots * self.slot_s + self.finish_s


def run_cost(model: ModelName, pairs: int, schedule: Schedule) -> RunCost:
    """Return the cost of fitting a model to ``pairs`` pairs under a schedule."""
    cost = CAMERA_MODELS[model].cost
    individual_ns = cost.individual_ns + cost.pair_ns * pairs
    slot_s = 1e-3 * SLOT_MS + 1e-9 * schedule.population * schedule.generations * individual_ns
    finish_s = 1e-3 * FINISH_MS + 1e-6 * cost.finish_pair_us * pairs + 1e-9 * OUTLIER_PAIR_NS * pairs**2
    return RunCost(slot_s, schedule.slots * schedule.max_iterations, finish_s)


def comparison_s(cameras: int, pairs: int) -> float:
    """Return the seconds that comparing every two cameras takes, each with at most ``pairs`` pairs."""
    return 1e-6 * SHARED_PAIR_US * pairs * cameras * (cameras - 1) / 2


# One trip (claim, look, finish, a Celery message) of two pool processes on an idle 2-core machine: 5.8 ms on
# PostgreSQL and 4.0 ms on SQLite, medians of 300 jobs with almost nothing to do (`make bench-farm`).
TRIP_MS = 6.0
# A slot farmed on its own should be worth this many trips, so that the queue costs at most a tenth.
TRIPS_PER_BUNDLE = 10
# Other fleets wait for a bundle, and it is lost with its worker. Trips cost a thousandth of it.
BUNDLE_S = 5.0
# Return the cost of a whole run in one job, with all its iterations. Most runs end after a third of them.
RUN_S = 60.0
# Rows that one transaction inserts: half a second on a busy machine, in which SQLite lets nobody else write.
RUN_SLOTS = 2000


class Farming(NamedTuple):
    """How a run is farmed: ``runs`` (one job) or ``slots`` (jobs of ``bundle`` slots per iteration)."""

    farm: str
    bundle: int


def choose_farming(farm: str, *, slots: int, cost: RunCost, waiting_runs: int, workers: int) -> Farming:
    """Decide how a run is farmed.

    Args:
        farm: ``slots`` is one slot a job; ``runs`` is one run a job where that is not too long; ``auto`` decides.
        slots: slots of one iteration.
        cost: see :func:`service.platform.jobs.bundles.run_cost`.
        waiting_runs: runs that are there to be worked on, this one and its calibration's others included. These end
            sooner side by side than slot by slot, also on idle processes (`make bench-latency`).
        workers: pool processes of the farm.
    """
    if farm == "slots":
        return Farming("slots", 1)
    bundle = max(1, ceil(1e-3 * TRIPS_PER_BUNDLE * TRIP_MS / cost.slot_s))
    busy = farm == "runs" or waiting_runs >= workers
    if (busy or bundle * 2 > slots) and cost.seconds <= RUN_S and cost.slots <= RUN_SLOTS:
        return Farming("runs", slots)
    if busy:
        bundle = max(bundle, int(BUNDLE_S / cost.slot_s))
    return Farming("slots", min(bundle, slots))


def cut(count: int, size: int) -> list[range]:
    """``count`` things in bundles of ``size``, the last one shorter."""
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def shards(sweeps: int, workers: int, *, least: int = 300) -> list[range]:
    """A recording's sweeps in at most ``workers`` shards of at least ``least`` sweeps."""
    parts = max(1, min(workers, sweeps // least))
    return cut(sweeps, max(1, ceil(sweeps / parts)))
