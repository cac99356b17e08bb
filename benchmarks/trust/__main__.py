"""`python -m benchmarks.trust`: does the verdict of a report name what is wrong, and leave sound results alone?

Walks are simulated, detected, paired, marked and calibrated as in `make bench-coverage`; on each walk every fault is
planted once. Drives are simulated and judged by their edges, see `benchmarks/trust/road.py`. RUNS: walks (20 by
default); DRIVES: drives (half of RUNS by default), of 30 frames and 20 mounts each; SEED: of the first.

A table of the faults goes to stderr: how many, the share that is named, and the largest share that any test could
name, where that is known. One line of JSON goes to stdout: `worst_fault_named`, the least share over the faults at
their larger size of verdicts that name them; `sound_accused`, the share of sound results whose verdict is `stop`.
Both are null where nothing was judged.
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
from multiprocessing import get_context

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.trust.road import lane_figures, on_drive  # noqa: E402
from benchmarks.trust.road import summary as road_summary  # noqa: E402
from benchmarks.trust.runs import Told, recording  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402

_OF_LANES = ("lane_score_ratio", "lane_peak_deg")


def main() -> None:
    """Judge all cells of all walks and all drives, and print the figures."""
    runs, seed = int(os.environ.get("RUNS", "20")), int(os.environ.get("SEED") or secrets.randbelow(10**9))
    drives = int(os.environ.get("DRIVES", runs // 2))
    began = time.perf_counter()
    workers = int(os.environ.get("WORKERS") or os.cpu_count() or 1)
    lanes = lane_figures()
    with ProcessPoolExecutor(workers, get_context("spawn"), warm_up) as pool:
        # The longest jobs are begun first.
        driven = pool.map(on_drive, range(seed, seed + drives))
        walked = pool.map(partial(recording, seed), range(runs))
        judged = [cell for found in walked for cell in found]
        road = road_summary(list(driven))
    said = {"bench": "trust", "seed": seed, "runs": runs, **summary(judged)}
    said |= {name: lanes[name] for name in _OF_LANES} | road
    print(json.dumps(said | {"seconds": round(time.perf_counter() - began, 1)}))


def summary(judged: Iterable[Told]) -> dict[str, float | None]:
    """The figures over all cells of walks."""
    named: dict[str, list[bool]] = defaultdict(list)
    bounds: dict[str, list[float]] = defaultdict(list)
    asked: set[str] = set()
    accused: list[bool] = []
    for one in judged:
        if one.fault is None:
            accused.append(one.level == "stop")
            for sentence in one.against:
                print(f"against a sound result: {sentence}", file=sys.stderr)
        elif one.is_named is not None:
            named[one.fault].append(one.is_named)
            if one.bound is not None:
                bounds[one.fault].append(one.bound)
            if one.is_asked:
                asked.add(one.fault)
    share = {fault: sum(found) / len(found) for fault, found in named.items()}
    print(f"{'fault':30}{'cells':>6}{'named':>8}{'bound':>8}", file=sys.stderr)
    for fault, value in share.items():
        bound = f"{sum(bounds[fault]) / len(bounds[fault]):8.3f}" if bounds[fault] else ""
        print(f"{fault:30}{len(named[fault]):6}{value:8.3f}{bound}", file=sys.stderr)
    return {
        "worst_fault_named": min((round(share[fault], 3) for fault in asked), default=None),
        "sound_accused": round(sum(accused) / len(accused), 3) if accused else None,
    }


if __name__ == "__main__":
    main()
