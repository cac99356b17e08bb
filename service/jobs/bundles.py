"""How solver work is cut into jobs: a model of what a slot costs and what a trip through the queue costs.

The cut never changes a result, only how long it takes.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

# One trip (claim, look, finish, a Celery message) of two pool processes on an idle 2-core machine: 5.8 ms on
# PostgreSQL and 4.0 ms on SQLite, medians of 300 jobs with almost nothing to do (`make bench-farm`).
TRIP_MS = 6.0
# A slot farmed on its own should be worth this many trips, so that the queue costs at most a tenth.
TRIPS_PER_BUNDLE = 10
# Projections per millisecond of one core inside a slot: 800 x 30 on 222 points took 4.0, 8.1 and 10.6 ms.
PROJECTIONS_PER_MS = {"pinhole": 1.3e6, "brown_conrady": 0.66e6, "kannala_brandt": 0.5e6}


class Plan(NamedTuple):
    """How a run is farmed: ``runs`` (one job) or ``slots`` (jobs of ``bundle`` slots per iteration)."""

    farm: str
    bundle: int


def slot_ms(model: str, pairs: int, population: int, generations: int) -> float:
    """Expected milliseconds of one GA slot."""
    return population * generations * pairs / PROJECTIONS_PER_MS[model]


def plan(farm: str, *, slots: int, slot_cost_ms: float, waiting_runs: int, workers: int) -> Plan:
    """Decide how a run is farmed.

    Args:
        farm: ``runs`` and ``slots`` (one slot a job) are taken as said; ``auto`` decides.
        slots: slots of one iteration.
        slot_cost_ms: see :func:`slot_ms`.
        waiting_runs: runs that are there to be worked on, this one included.
        workers: pool processes of the farm.
    """
    if farm == "runs":
        return Plan("runs", slots)
    if farm == "slots":
        return Plan("slots", 1)
    bundle = max(1, ceil(TRIPS_PER_BUNDLE * TRIP_MS / max(slot_cost_ms, 1e-6)))
    if waiting_runs >= workers or bundle * 2 > slots:
        return Plan("runs", slots)
    return Plan("slots", bundle)


def cut(count: int, size: int) -> list[range]:
    """``count`` things in bundles of ``size``, the last one shorter."""
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def shards(sweeps: int, workers: int, *, least: int = 300) -> list[range]:
    """A recording's sweeps in at most ``workers`` shards of at least ``least`` sweeps."""
    parts = max(1, min(workers, sweeps // least))
    return cut(sweeps, max(1, ceil(sweeps / parts)))
