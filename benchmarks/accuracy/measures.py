"""What one rig tells: did the search and the polish reach the optimum, and were the error bars right?"""

import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.accuracy.error_bars import error_bars, weighted_error_bars
from benchmarks.accuracy.rigs import Rig, draw_rig, with_outliers
from workers.geometry.models import DEFAULT_MODELS as MODELS
from workers.geometry.models import ModelName
from workers.solver.baselines import baseline, linear_baseline
from workers.solver.estimate import estimate
from workers.solver.polish import Fit, cost_of, polish
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict
from workers.solver.schedule import run_schedule
from workers.solver.slot import run_slot

PAPER = {"slots": 5, "population": 800, "generations": 30}
OUTLIER_SHARES = (0.1, 0.2, 0.3)
WITHIN = 1.001
"""A cost within 0.1 % of the optimum's counts as the optimum."""


def measure(model: ModelName, seed: tuple[int, int]) -> dict[str, Any]:
    """All measures of one fresh rig, reproducible from (seed, number)."""
    rng = np.random.default_rng((*seed, MODELS.index(model)))
    rig = draw_rig(model, rng)
    problem = rig.problem(seed=int(rng.integers(2**31)), schedule=PAPER)
    found = _search(rig, problem, rng) | weighted_error_bars(rig, rng)
    found["any_mount"] = _any_mount(model, rng)
    for share in OUTLIER_SHARES:
        found[f"outliers_{share:.0%}"] = _outliers(rig, share, rng)
    return found


def _search(rig: Rig, problem: FitProblem, rng: np.random.Generator) -> dict[str, Any]:
    began = time.process_time()
    state, _ = run_schedule(problem)
    seconds = time.process_time() - began
    began = time.process_time()
    found = estimate(problem, np.array(state.best_parameters))
    finish_seconds = time.process_time() - began
    optimum = estimate(problem, rig.truth)
    fit, best = found.fit, optimum.fit
    lowest = best_loss(problem, best)
    linear = linear_baseline(optimum.fitted)

    def is_optimum(other: Fit | None) -> bool:
        return other is not None and cost_of(optimum.fitted, other.parameters) <= WITHIN * best.cost

    return {
        "success": is_optimum(fit),
        "centre_success": is_optimum(baseline(optimum.fitted)),
        "linear_success": is_optimum(linear),
        "ga_alone": state.best_loss <= 1.01 * lowest,
        "ga_over_optimum": state.best_loss / lowest,
        "ga_seconds": seconds,
        "finish_seconds": finish_seconds,
        "iterations": state.iteration,
        "mean_px": fit.mean_px,
        "rms_px": fit.rms_px,
        **error_bars(rig, problem, optimum if best.rms_px < fit.rms_px else found, rng),
    }


def best_loss(problem: FitProblem, best: Fit) -> float:
    """The optimum of the search's loss: iteratively reweighted least squares from the least-squares optimum."""
    squares = replace(problem, loss="mean")
    bend = 1.0 / problem.saturation_px if problem.loss == "saturating" else 0.0
    p, lowest = np.array(best.parameters), np.inf
    for _ in range(40):
        difference = predict(problem, p)[0] - problem.pixels
        distance = np.hypot(difference[:, 0], difference[:, 1])
        before, lowest = lowest, min(lowest, float(np.mean(distance / (1.0 + bend * distance))))
        if before - lowest < 1e-7 * lowest:
            break
        weights = 1.0 / (np.maximum(distance, 1e-3) * (1.0 + bend * distance) ** 2)
        p = np.array(polish(replace(squares, weights=weights), p).parameters)
    return lowest


def _any_mount(model: ModelName, rng: np.random.Generator) -> bool:
    rig = draw_rig(model, rng, any_mount=True)
    problem = rig.problem(seed=int(rng.integers(2**31)), rotation_range_deg=180.0)
    outcome = run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
    return polish(problem, outcome.parameters).cost <= WITHIN * polish(problem, rig.truth).cost


def _outliers(rig: Rig, share: float, rng: np.random.Generator) -> bool:
    # By the default schedule, as a user runs it.
    marks, _ = with_outliers(rig, share, rng)
    problem = rig.problem(marks, seed=int(rng.integers(2**31)), outliers="keep")
    state, _ = run_schedule(problem)
    fit, best = polish(problem, state.best_parameters), polish(problem, rig.truth)
    # The robust scale follows from the fit: both are compared at the truth's.
    return cost_of(problem, fit.parameters, best.scale_px) <= WITHIN * best.cost
