from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.rigs import simulated
from workers.geometry.models import MODELS, SEARCH_FORMS
from workers.solver.fitness import evaluate_population, fitness_of, loss_px
from workers.solver.outcomes import NEVER, flag_of
from workers.solver.slot import run_slot, warm_up

GO_ON = flag_of(NEVER)
SHORT = {"population": 160, "generations": 12}


def outcome(problem, slot=0, iteration=0):
    return run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), iteration, slot)


@pytest.mark.parametrize("model", MODELS)
def test_same_slot_same_bits_other_slot_other_bits(model):
    problem, _ = simulated(model, 3, schedule=SHORT)
    again, _ = simulated(model, 3, schedule=SHORT)
    assert outcome(problem) == outcome(again)
    others = [outcome(problem, slot=1), outcome(problem, iteration=1)]
    others += [outcome(replace(problem, **part)) for part in ({"seed": 4}, {"camera": "rear"}, {"fold": 0})]
    assert len({other.parameters for other in [outcome(problem), *others]}) == 6


@pytest.mark.parametrize("search", SEARCH_FORMS)
@pytest.mark.parametrize("model", MODELS)
def test_single_precision_fitness_is_the_double_precision_loss(model, search):
    for loss in ("mean", "saturating"):
        problem, truth = simulated(model, 5, search=search, loss=loss, priors={"f_x": {"mean": 600, "sigma": 50}})
        rng = np.random.default_rng(0)
        free, low, width = problem.free, problem.lower, problem.upper - problem.lower
        population = rng.random((len(free), 40)).astype(np.float32)
        if search == "rotation_vector":
            near = ((truth - low) / width)[:, None] + rng.normal(size=(len(free), 20)) * 0.01
            population[:, :20] = np.clip(near, 0, 1).astype(np.float32)
        losses = np.empty(40, dtype=np.float32)
        fitness = fitness_of(problem, low, problem.upper)
        evaluate_population(fitness.total_distances, fitness.data, population, losses, 0, GO_ON)
        expected = [loss_px(problem, low + width * population[:, i].astype(float)) for i in range(40)]
        # One point on the other side of a fold's edge may move a mean by a pair's share of the diagonal.
        close = np.isclose(losses, expected, rtol=1e-4)
        assert close.mean() >= 0.9, (losses, expected)
        np.testing.assert_allclose(losses, expected, rtol=0.05)


def test_locked_parameters_never_move_and_bounds_hold():
    locks = {"f_x": 650.125, "rotation_y": 0.1, "t_z": 0.25}
    problem, _ = simulated("brown_conrady", 7, locked=locks, schedule=SHORT)
    for slot in range(3):
        found = dict(zip(problem.names, outcome(problem, slot).parameters, strict=True))
        assert {name: found[name] for name in locks} == locks
        for name, value in found.items():
            assert problem.bounds[name][0] <= value <= problem.bounds[name][1]


def test_everything_locked_is_just_evaluated():
    problem, truth = simulated("pinhole", 7)
    locks = dict(zip(problem.names, truth.tolist(), strict=True))
    problem, _ = simulated("pinhole", 7, locked=locks)
    found = outcome(problem)
    assert found.parameters == tuple(truth.tolist())
    assert found.evaluations == 0
    assert found.loss == pytest.approx(1.25, rel=0.15)


def test_evaluations_are_counted():
    problem, _ = simulated("pinhole", 1, schedule={"population": 800, "generations": 30})
    assert outcome(problem).evaluations == 800 + 29 * 792


def test_warm_up_leaves_nothing_to_compile():
    warm_up()
    before = len(evaluate_population.signatures)
    problem, _ = simulated("brown_conrady", 1, search="euler", loss="saturating", schedule=SHORT)
    outcome(problem)
    assert len(evaluate_population.signatures) == before
