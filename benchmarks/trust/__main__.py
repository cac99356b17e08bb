"""`python -m benchmarks.trust`: does the verdict of a report name what is wrong, and leave sound results alone?

Walks are simulated, detected, paired, marked and calibrated as in `make bench-coverage`; on each walk every fault is
planted once. RUNS: walks (default 20); SEED: of the first. A table of the faults goes to stderr, one line of JSON to
stdout: `worst_fault_named`, the least share over the faults at their larger size of verdicts that name them;
`sound_accused`, the share of sound results whose verdict is `unsound`; both are null where nothing was judged. The
figures of lane markers and edges are null where `benchmarks/trust/road.py` does not make them.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_context
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.trust.runs import Told, recording  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402

_OF_ROAD = ("lane_score_ratio", "lane_peak_deg", "knock_found", "knock_false")


def main() -> None:
    """Judge all cells of all walks and print the figures."""
    runs, seed = int(os.environ.get("RUNS", "20")), int(os.environ.get("SEED") or secrets.randbelow(10**9))
    began = time.perf_counter()
    workers = int(os.environ.get("WORKERS") or os.cpu_count() or 1)
    with ProcessPoolExecutor(workers, get_context("spawn"), warm_up) as pool:
        judged = [cell for found in pool.map(partial(recording, seed), range(runs)) for cell in found]
    print(json.dumps({"bench": "trust", "seed": seed, "runs": runs, **summary(judged), **_road(), **_took(began)}))


def summary(judged: Iterable[Told]) -> dict[str, float | None]:
    """The figures over all cells."""
    named: dict[str, list[bool]] = defaultdict(list)
    asked: set[str] = set()
    accused: list[bool] = []
    for one in judged:
        if one.fault is None:
            accused.append(one.level == "unsound")
            for sentence in one.against:
                print(f"against a sound result: {sentence}", file=sys.stderr)
        elif one.is_named is not None:
            named[one.fault].append(one.is_named)
            if one.is_asked:
                asked.add(one.fault)
    share = {fault: sum(found) / len(found) for fault, found in named.items()}
    for fault, value in share.items():
        print(f"{fault:22}{len(named[fault]):5}{value:8.3f}", file=sys.stderr)
    return {
        "worst_fault_named": min((round(share[fault], 3) for fault in asked), default=None),
        "sound_accused": round(sum(accused) / len(accused), 3) if accused else None,
    }


def _road() -> dict[str, Any]:
    if find_spec("benchmarks.trust.road") is None:
        return dict.fromkeys(_OF_ROAD)
    found = import_module("benchmarks.trust.road").figures()
    return {name: found.get(name) for name in _OF_ROAD}


def _took(began: float) -> dict[str, float]:
    return {"seconds": round(time.perf_counter() - began, 1)}


if __name__ == "__main__":
    main()
