"""One rig, four ways to calibrate it: which of them reach the optimum, and is the optimum any good?"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.accuracy.measures import WITHIN
from benchmarks.accuracy.rigs import PLAIN, Rig
from workers.solver.baselines import baseline, linear_baseline
from workers.solver.narrowing import run_search
from workers.solver.polish import Fit, cost_of, distances, polish
from workers.solver.problem import FitProblem
from workers.solver.slot import run_slot

RIGHT_PX, FIELD_SHARE = 3.0, 0.9
"""A calibration counts as right where nine tenths of the field lie within three sigmas of a mark from the truth. Not
all of it: no fit from noisy marks knows a lens beyond the outermost mark."""


@dataclass(frozen=True, eq=False)
class Case:
    """A rig to calibrate, the same camera with noiseless vertices all over the field, and how it is requested."""

    rig: Rig
    check: Rig
    request: dict[str, Any] = field(default_factory=dict)


def by_search(problem: FitProblem) -> Fit:
    """The genetic algorithm with the default preset, and the polish."""
    return polish(problem, run_search(problem).best_parameters)


def by_one_slot(problem: FitProblem) -> Fit:
    """One slot of it over the whole bounds, and the polish."""
    return polish(problem, run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0).parameters)


METHODS: dict[str, Callable[[FitProblem], Fit | None]] = {
    "ga": by_search,
    "one_slot": by_one_slot,
    "centre": baseline,  # least squares from the centre of the bounds
    "linear": linear_baseline,  # from the linear cameras that RANSAC finds
}


def compare(case: Case, seed: int) -> dict[str, dict[str, float]]:
    """What each way reached, beside the optimum: what the polish reaches from the true parameters.

    `success`: the cost is at most 0.1 % above that optimum's. Where the loss is `saturating` the optimum is that of
    the robust loss, and both costs are taken at the robust scale of the optimum. `right`: FIELD_SHARE of the field
    lies within RIGHT_PX of the truth.
    """
    problem = case.rig.problem(seed=seed, **(PLAIN | case.request))
    check = case.check.problem(rotation_range_deg=180.0)
    best = polish(problem, case.rig.truth)

    def is_right(parameters: Sequence[float]) -> bool:
        return float(np.quantile(distances(check, parameters), FIELD_SHARE)) <= RIGHT_PX

    ways = {"optimum": {"success": 1.0, "right": is_right(best.parameters), "seconds": 0.0}}
    for name, method in METHODS.items():
        began = time.process_time()
        fit = method(problem)
        seconds = time.process_time() - began
        success = fit is not None and cost_of(problem, fit.parameters, best.scale_px) <= WITHIN * best.cost
        right = fit is not None and is_right(fit.parameters)
        ways[name] = {"success": success, "right": right, "seconds": seconds}
    return ways
