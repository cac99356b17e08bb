"""The solver's bench: evaluations until a search is within 1 % of an optimum that another library found."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.rigs import PLAIN, draw_rig
from benchmarks.solver.contest import GENERATIONS, POPULATION, Contest
from benchmarks.solver.target import WITHIN, evaluations_of_slot_to, optimum
from workers.solver.residuals import predict
from workers.solver.slot import run_slot


def test_the_target_is_an_optimum_and_its_evaluations_are_counted():
    rig = draw_rig("pinhole", np.random.default_rng(3))
    schedule = {"population": POPULATION, "generations": GENERATIONS}
    problem = rig.problem(seed=3, schedule=schedule, **PLAIN)
    best = optimum(problem, rig.truth)
    assert best.rms_of_polish == pytest.approx(1.0, abs=1e-6)
    apart = np.hypot(*(predict(problem, rig.truth)[0] - rig.marks).T).mean()
    assert 0.9 * apart < best.mean_px < apart

    target_px = WITHIN * best.mean_px
    for generations in range(1, GENERATIONS + 1):
        shorter = replace(problem, schedule=replace(problem.schedule, generations=generations))
        outcome = run_slot(shorter, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
        if outcome.loss <= target_px:
            break
    assert evaluations_of_slot_to(target_px, problem) == outcome.evaluations < POPULATION * GENERATIONS
    assert evaluations_of_slot_to(0.5 * best.mean_px, problem) is None

    contest = Contest(problem, 3)
    truth = (rig.truth - problem.lower) / (problem.upper - problem.lower)
    contest.losses(np.full((75, contest.genes), 0.5))
    contest.losses(np.tile(truth, (3, 1)))
    contest.losses(np.tile(truth, (100, 1)))
    assert contest.evaluations_to(1.2 * best.mean_px) == 78
    assert contest.evaluations_to(0.5 * best.mean_px) is None
