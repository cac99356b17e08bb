"""`python -m benchmarks.solver.crossovers`: which crossover reaches the optimum, at what cost; RIGS, MODELS, SEED."""

import json
import os
import secrets
import sys
import time
from typing import Any

import numpy as np

from benchmarks.accuracy.measures import PAPER, best_loss
from benchmarks.accuracy.rigs import PLAIN, draw_rig
from benchmarks.solver.operators import OPERATORS, searching_with
from workers.geometry.models import MODELS, parse_model
from workers.solver.polish import polish
from workers.solver.problem import FitProblem
from workers.solver.schedule import State, advance, bounds_of, start
from workers.solver.slot import run_slot

SCHEDULE = {**PAPER, "patience": 5}
"""The paper's numbers, and its patience: the slower operators need it."""


def search(problem: FitProblem, operator: int) -> State:
    """The whole schedule with that operator in its slots."""
    state, one = start(problem), searching_with(operator)
    while state.stopped is None:
        lower, upper = (end.tolist() for end in bounds_of(problem, state))
        slots = range(problem.schedule.slots)
        state = advance(
            problem, state, [run_slot(problem, lower, upper, state.iteration, slot, one) for slot in slots]
        )
    return state


def main() -> None:
    rigs, seed = int(os.environ.get("RIGS", "100")), int(os.environ.get("SEED") or secrets.randbits(31))
    models = [parse_model(name) for name in os.environ.get("MODELS", ",".join(MODELS)).split(",")]
    result: dict[str, Any] = {}
    for model in models:
        excess: dict[str, list[float]] = {name: [] for name in OPERATORS}
        spent: dict[str, list[float]] = {name: [] for name in OPERATORS}
        iterations: dict[str, list[int]] = {name: [] for name in OPERATORS}
        one_slot: dict[str, list[float]] = {name: [] for name in OPERATORS}
        once = {**SCHEDULE, "max_iterations": 1, "slots": 1}
        warm = draw_rig(model, np.random.default_rng(0)).problem(schedule=once, **PLAIN)
        for operator in range(len(OPERATORS)):
            search(warm, operator)
        for number in range(rigs):
            rig = draw_rig(model, np.random.default_rng((seed, number, MODELS.index(model))))
            problem = rig.problem(seed=number, schedule=SCHEDULE, **PLAIN)
            lowest = best_loss(problem, polish(problem, rig.truth))
            for operator, name in enumerate(OPERATORS):
                began = time.process_time()
                state = search(problem, operator)
                spent[name].append(time.process_time() - began)
                excess[name].append(state.best_loss / lowest)
                iterations[name].append(state.iteration)
                one_slot[name].append(state.first_slot_losses[0] / lowest)
        result[model] = {
            name: {
                "within_1_percent": round(float(np.mean(np.array(excess[name]) <= 1.01)), 3),
                "median_over_optimum": round(float(np.median(excess[name])), 4),
                "worst_over_optimum": round(max(excess[name]), 3),
                "seconds": round(float(np.mean(spent[name])), 3),
                "one_slot_median_over_optimum": round(float(np.median(one_slot[name])), 4),
                "iterations": round(float(np.mean(iterations[name])), 1),
            }
            for name in OPERATORS
        }
        for name, figures in result[model].items():
            print(model, name, figures, file=sys.stderr, flush=True)
    print(json.dumps({"rigs": rigs, "seed": seed, **result}))


if __name__ == "__main__":
    main()
