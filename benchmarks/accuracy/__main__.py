"""`python -m benchmarks.accuracy`: an object per model, one line of JSON. RIGS, MODELS and SEED narrow it.

`rms_over_crb` and `coverage95` are over 8 draws of the marks' noise per rig, the first the one that was searched;
`weighted_...` over vertices of unequal sigma.

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
from benchmarks.accuracy.measures import OUTLIER_SHARES, measure  # noqa: E402
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


def summary(found: Sequence[dict[str, Any]], seed: int) -> dict[str, Any]:
    """The figures over all rigs of a model; `_se` is a standard error by bootstrap over the rigs."""

    def mean(key: str) -> float:
        return float(np.mean([one[key] for one in found]))

    shares = {f"outliers_{share:.0%}": mean(f"outliers_{share:.0%}") for share in OUTLIER_SHARES}
    inside = [one for one in found if one["inside"]]
    unequal = [one for one in found if one["weighted_scores"]]
    figures = {
        "success": mean("success"),
        "ga_alone": mean("ga_alone"),
        "ga_seconds": mean("ga_seconds"),
        "finish_seconds": mean("finish_seconds"),
        "ga_seconds_worst": max(one["ga_seconds"] for one in found),
        "ga_over_optimum_worst": max(one["ga_over_optimum"] for one in found),
        "iterations": mean("iterations"),
        **_bars("rms_over_crb", [one["squared_scores"] for one in inside], seed),
        **_share("coverage95", [one["held"] for one in inside]),
        **_bars("weighted_over_crb", [one["weighted_scores"] for one in unequal], seed),
        **_bars("equal_over_weighted_crb", [one["equal_scores"] for one in unequal], seed),
        **_share("weighted_coverage95", [one["weighted_held"] for one in unequal]),
        "any_mount": mean("any_mount"),
        "outliers": min(shares.values()),
        **shares,
        "centre_success": mean("centre_success"),
        "linear_success": mean("linear_success"),
        "mean_px": mean("mean_px"),
        "rms_px": mean("rms_px"),
        "turn_crb_deg": float(np.median([one["turn_crb_deg"] for one in found])),
        "rigs_past_bounds": len(found) - len(inside),
    }
    return {key: round(value, 4) if isinstance(value, float) else value for key, value in figures.items()}


def _bars(name: str, scores: list[Any], seed: int) -> dict[str, float | None]:
    value, error = root_mean_square(scores, seed) if scores else (None, None)
    return {name: value, f"{name}_se": error}


def _share(name: str, hits: list[Any]) -> dict[str, float | None]:
    means = np.array([np.mean(one) for one in hits])
    error = float(np.std(means) / np.sqrt(len(means))) if len(means) else None
    return {name: float(means.mean()) if len(means) else None, f"{name}_se": error}


if __name__ == "__main__":
    main()
