"""Cuts solver work into jobs, by its cost and by that of a trip through the queue.

The cut never changes a result, only how long it takes.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

from service.platform.jobs.costs import RunCost

# One trip (claim, look, finish, a Celery message) of two pool processes on an idle 2-core machine: 5.8 ms on
# PostgreSQL and 4.0 ms on SQLite, medians of 300 jobs with almost nothing to do (`make bench-farm`).
TRIP_MS = 6.0
# A slot farmed on its own should be worth this many trips, so that the queue costs at most a tenth.
TRIPS_PER_BUNDLE = 10
# Other fleets wait for a bundle, and it is lost with its worker. Trips cost a thousandth of it.
BUNDLE_S = 5.0
# The same for a whole run in one job, with all its iterations. Most runs end after a third of them.
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
        cost: see :func:`service.platform.jobs.costs.run_cost`.
        waiting_runs: runs that are there to be worked on, this one included.
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
