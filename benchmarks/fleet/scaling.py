"""How many fits a second more hosts bring, computed and simulated from what one fit costs each part of the service.

Nobody here has a hundred hosts. A fit is a customer of a closed queueing network: it is planned by the API, handed
out by the broker, read and written by the database, and fitted by a pool process, each for as long as `bench-fleet`
has measured in processor time. The bound is that of operational analysis (Denning and Buzen 1978): a part whose
processors are all busy does no more. The simulation draws exponential times and lets fits wait for one another. It
knows no network, no locks and no disks.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

HOSTS: Final = (1, 2, 5, 10, 20, 50, 100)
PROCESSES: Final = 8
"""Pool processes of a host."""
SERVERS: Final = {"api": 1, "broker": 1, "postgres": 8}
"""Processors that each part may use: one API process, a broker with one thread, a database with a host of its own."""
_VISITS: Final = {"api": 1, "broker": 2, "postgres": 7}  # of a fit: its plan, its messages, its transactions
_FITS: Final = 4000
_WARM: Final = 0.25  # of the fits, before rates are counted


class Scale(NamedTuple):
    """fits_per_s: computed at most, and simulated; busiest: the part that is busy for the largest share of time."""

    hosts: int
    bound_per_s: float
    simulated_per_s: float
    busiest: str
    busy: float


def scaled(cost_s: Mapping[str, float], seed: int) -> list[Scale]:
    """For each number of hosts; cost_s: processor seconds of a fit by part, `worker` among them."""
    return [_scale(cost_s, hosts, np.random.default_rng([seed, hosts])) for hosts in HOSTS]


def _scale(cost_s: Mapping[str, float], hosts: int, random: np.random.Generator) -> Scale:
    processes = hosts * PROCESSES
    parts = {name: SERVERS[name] / cost_s[name] for name in SERVERS}
    alone_per_s = processes / (cost_s["worker"] + sum(cost_s[name] for name in SERVERS))
    rate = _simulated(cost_s, processes, random)
    busy = {name: rate / parts[name] for name in parts} | {"worker": rate * cost_s["worker"] / processes}
    busiest = max(busy, key=lambda name: busy[name])
    return Scale(hosts, min(alone_per_s, *parts.values()), rate, busiest, busy[busiest])


def _simulated(cost_s: Mapping[str, float], processes: int, random: np.random.Generator) -> float:
    """Fits a second of so many processes that are never without a fit."""
    # A fit: planned, handed out, then its transactions with the work between them.
    share = 1.0 / _VISITS["postgres"]
    transaction = (("postgres", cost_s["postgres"] * share), ("worker", cost_s["worker"] * share))
    message = ("broker", cost_s["broker"] / _VISITS["broker"])
    way = (("api", cost_s["api"]), message, *transaction * _VISITS["postgres"], message)
    idle = dict(SERVERS)
    waiting: dict[str, deque[tuple[int, int]]] = {name: deque() for name in SERVERS}
    # When a visit ends, whose it is, and which of its visits.
    ends: list[tuple[float, int, int]] = []

    def begin(now_s: float, fit: int, visit: int) -> None:
        part, mean_s = way[visit]
        if part in idle:
            if not idle[part]:
                waiting[part].append((fit, visit))
                return
            idle[part] -= 1
        heapq.heappush(ends, (now_s + float(random.exponential(mean_s)), fit, visit))

    for fit in range(processes):
        begin(0.0, fit, 0)
    fits = _FITS + 4 * processes
    done, began_s, now_s = 0, 0.0, 0.0
    while done < fits:
        now_s, fit, visit = heapq.heappop(ends)
        part = way[visit][0]
        if part in idle:
            idle[part] += 1
            if waiting[part]:
                begin(now_s, *waiting[part].popleft())
        if visit + 1 == len(way):
            done += 1
            began_s = now_s if done <= _WARM * fits else began_s
        begin(now_s, fit, (visit + 1) % len(way))
    return (1.0 - _WARM) * fits / (now_s - began_s)
