"""More worker processes: a batch of calibrations, and one run farmed slot by slot."""

from __future__ import annotations

import sys
from statistics import median
from typing import Any

import numpy as np

from benchmarks.accuracy.rigs import draw_rig
from benchmarks.farm.asking import Asker
from benchmarks.house import House

WORKERS = (1, 2, 4)
_BATCHED: dict[str, Any] = {"models": ["brown_conrady"], "folds": 0, "farm": "runs"}
# The authors' own: 20 slots of 2000 x 50, one iteration.
_TOOLBOX: dict[str, Any] = {"models": ["brown_conrady"], "preset": "toolbox", "folds": 0, "farm": "slots"}
_TOOLBOX_PAIRS = 2000


def scaling(house: House, rounds: int, batch: int, seed: int) -> dict[str, Any]:
    """Calibrations per second with 1, 2 and 4 worker processes; the toolbox's run on two over the same on one."""
    batched = Asker(house, "batches", draw_rig("brown_conrady", np.random.default_rng([seed, 2])))
    rig = draw_rig("brown_conrady", np.random.default_rng([seed, 3]), pairs=_TOOLBOX_PAIRS)
    farmed = Asker(house, "toolbox", rig)
    rates: dict[int, list[float]] = {workers: [] for workers in WORKERS}
    toolbox_s: dict[int, list[float]] = {1: [], 2: []}
    for number in range(rounds):
        for workers in WORKERS if number % 2 == 0 else reversed(WORKERS):
            house.restart_worker(workers)
            # Each pool process has its connections, and looks at its first job, before the time counts.
            batched.ask(2 * workers, **_BATCHED)
            seconds, _ = batched.ask(batch, **_BATCHED)
            rates[workers].append(batch / seconds)
            print(f"{workers} workers: {batch / seconds:.2f} calibrations per second", file=sys.stderr)
            if workers in toolbox_s:
                seconds, _ = farmed.ask(**_TOOLBOX)
                toolbox_s[workers].append(seconds)
                print(f"{workers} workers: the toolbox's run in {seconds:.2f} s", file=sys.stderr)
    return {
        "slot_speedup": median(one / two for one, two in zip(toolbox_s[1], toolbox_s[2], strict=True)),
        "toolbox_s": {str(workers): median(seconds) for workers, seconds in toolbox_s.items()},
        "scaling": {str(workers): median(found) for workers, found in rates.items()},
    }
