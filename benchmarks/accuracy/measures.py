"""What one rig tells: did the search and the polish reach the optimum, and were the error bars right?"""

import time
from typing import Any

import numpy as np

from benchmarks.accuracy.error_bars import error_bars
from benchmarks.accuracy.rigs import algorithm_2, draw_rig
from workers.geometry.models import DEFAULT_MODELS as MODELS
from workers.geometry.models import ModelName
from workers.solver.estimate import estimate
from workers.solver.narrowing import run_search
from workers.solver.polish import cost_of, polish
from workers.solver.slot import run_slot

PAPER = {"slots": 5, "population": 800, "generations": 30}
WITHIN = 1.001
"""A cost within 0.1 % of the optimum's counts as the optimum."""


def measure(model: ModelName, seed: tuple[int, int]) -> dict[str, Any]:
    """All measures of one fresh rig, reproducible from (seed, number)."""
    rng = np.random.default_rng((*seed, MODELS.index(model)))
    rig = draw_rig(model, rng)
    problem = algorithm_2(rig.problem(seed=int(rng.integers(2**31)), schedule=PAPER))
    began = time.process_time()
    state = run_search(problem)
    searched = time.process_time()
    reached = estimate(problem, np.array(state.best_parameters))
    finish_seconds = time.process_time() - searched
    optimum = estimate(problem, rig.truth)
    return {
        "success": cost_of(optimum.fitted, reached.fit.parameters) <= WITHIN * optimum.fit.cost,
        "ga_seconds": searched - began,
        "finish_seconds": finish_seconds,
        "iterations": state.iteration,
        **error_bars(rig, problem, optimum if optimum.fit.rms_px < reached.fit.rms_px else reached, rng),
        "any_mount": _any_mount(model, rng),
    }


def _any_mount(model: ModelName, rng: np.random.Generator) -> bool:
    rig = draw_rig(model, rng, any_mount=True)
    problem = rig.problem(seed=int(rng.integers(2**31)), rotation_range_deg=180.0)
    outcome = run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
    return polish(problem, outcome.parameters).cost <= WITHIN * polish(problem, rig.truth).cost
