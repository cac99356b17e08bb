"""`python -m benchmarks.solver`: what a slot of 800 x 30 costs beside the bare evaluation of as many individuals.

Both run interleaved on one core, ROUNDS times; the ratio is that of the medians of processor seconds. MODELS, SEED.
"""

import json
import os
import secrets
import sys
import time
from typing import Any

import numpy as np

from benchmarks.accuracy.rigs import PAIRS, draw_rig
from workers.geometry.models import MODEL_ID, MODELS, ModelName, parse_model
from workers.solver.fitness import evaluate_population
from workers.solver.slot import pack_pairs, prior_rows, run_slot, scales_of, warm_up

POPULATION, GENERATIONS = 800, 30


def measure(model: ModelName, seed: int, rounds: int) -> dict[str, Any]:
    """Ratio, bare rate, and the slot's loss on a fresh rig."""
    schedule = {"population": POPULATION, "generations": GENERATIONS}
    problem = draw_rig(model, np.random.default_rng(seed)).problem(seed=seed, schedule=schedule)
    lower, upper = problem.lower, problem.upper
    low, high = lower.tolist(), upper.tolist()
    pack, scales, prior, free = pack_pairs(problem), scales_of(problem), prior_rows(problem), problem.free
    # Individuals as a slot has them in its middle: near what it found, not all over the bounds.
    found = np.array(run_slot(problem, low, high, 0, 0).parameters)
    spread = np.random.default_rng(seed).normal(size=(len(free), POPULATION)) * 0.02
    centre = ((found - lower) / (upper - lower))[free, None]
    population = np.clip(centre + spread, 0.0, 1.0).astype(np.float32)
    losses = np.empty(POPULATION, dtype=np.float32)
    slot, bare = [], []
    outcome = run_slot(problem, low, high, 0, 0)
    for number in range(rounds):
        began = time.process_time()
        outcome = run_slot(problem, low, high, 0, number)
        slot.append((time.process_time() - began) / outcome.evaluations)
        began = time.process_time()
        for _ in range(GENERATIONS):
            evaluate_population(
                MODEL_ID[model], 0, pack, scales, lower, free, lower[free], (upper - lower)[free], prior, population,
                losses, 0,
            )  # fmt: skip
        bare.append((time.process_time() - began) / (GENERATIONS * POPULATION))
    return {
        "ratio_to_bare_evaluation": round(float(np.median(slot) / np.median(bare)), 3),
        "gprojections_per_s": round(PAIRS / float(np.median(bare)) * 1e-9, 3),
        "slot_ms": round(float(np.median(slot)) * outcome.evaluations * 1e3, 2),
        "slot_loss_px": round(outcome.loss, 3),
    }


def main() -> None:
    rounds, seed = int(os.environ.get("ROUNDS", "60")), int(os.environ.get("SEED") or secrets.randbits(31))
    warm_up()
    result: dict[str, Any] = {}
    for name in os.environ.get("MODELS", ",".join(MODELS)).split(","):
        result[name] = measure(parse_model(name), seed, rounds)
        print(name, result[name], file=sys.stderr)
    print(json.dumps({"rounds": rounds, "seed": seed, **result}))


if __name__ == "__main__":
    main()
