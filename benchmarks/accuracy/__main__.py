"""`python -m benchmarks.accuracy`: an object per model, one line of JSON. RIGS, MODELS and SEED narrow it.

`rms_over_crb` and `coverage95` are over 8 draws of the marks' noise per rig, the first the one that was searched.

Seconds are processor seconds of one core, so that a busy machine does not count.
"""

import json
import os
import secrets
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.accuracy.error_bars import root_mean_square  # noqa: E402
from benchmarks.accuracy.measures import measure  # noqa: E402
from workers.geometry.models import DEFAULT_MODELS as MODELS  # noqa: E402
from workers.geometry.models import parse_model  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def main() -> None:
    rigs, seed = int(os.environ.get("RIGS", "300")), int(os.environ.get("SEED") or secrets.randbits(31))
    models = [parse_model(name) for name in os.environ.get("MODELS", ",".join(MODELS)).split(",")]
    began = time.perf_counter()
    warm_up()
    result: dict[str, Any] = {}
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), warm_up) as pool:
        for model in models:
            found = list(pool.map(partial(measure, model), [(seed, n) for n in range(rigs)]))
            result[model] = summary(found, seed)
            print(model, json.dumps(result[model]), file=sys.stderr)
    seconds = round(time.perf_counter() - began, 1)
    print(json.dumps({"rigs": rigs, "seed": seed, **result, "seconds": seconds}))


def summary(rigs: Sequence[dict[str, Any]], seed: int) -> dict[str, Any]:
    """The figures over all rigs of a model; `_se` is a standard error by bootstrap over the rigs."""
    names = ("success", "any_mount", "iterations", "ga_seconds", "finish_seconds")
    figures: dict[str, Any] = {name: float(np.mean([rig[name] for rig in rigs])) for name in names}
    inside = [rig for rig in rigs if rig["inside"]]
    if inside:
        over, over_se = root_mean_square([rig["squared_scores"] for rig in inside], seed)
        coverage = [float(np.mean(rig["held"])) for rig in inside]
        figures |= {"rms_over_crb": over, "rms_over_crb_se": over_se}
        figures |= {"coverage95": np.mean(coverage), "coverage95_se": np.std(coverage) / len(inside) ** 0.5}
    return {name: round(float(value), 4) for name, value in figures.items()} | {"rigs_inside": len(inside)}


if __name__ == "__main__":
    main()
