"""The solver's bench: evaluations until a search is within 1 % of an optimum that another library found."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.rigs import PLAIN, draw_rig
from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Finish, Peer
from benchmarks.solver.target import WITHIN, evaluations_of_ours_to, evaluations_to, optimum
from workers.solver.residuals import predict
from workers.solver.slot import run_slot


@pytest.fixture(scope="module")
def race():
    rig = draw_rig("pinhole", np.random.default_rng(3))
    schedule = {"population": POPULATION, "generations": GENERATIONS}
    contest = Contest(rig.problem(seed=3, schedule=schedule, **PLAIN), 3)
    return rig, contest, optimum(contest.problem, rig.truth)


def test_the_optimum_is_one_of_the_mean_distance(race):
    rig, contest, best = race
    assert best.rms_of_polish == pytest.approx(1.0, abs=1e-6)
    apart = predict(contest.problem, rig.truth)[0] - rig.marks
    assert 0.9 * np.mean(np.hypot(*apart.T)) < best.mean_px < np.mean(np.hypot(*apart.T))


def test_a_slot_reaches_the_target_with_the_generations_that_are_counted(race):
    _, contest, best = race
    count = evaluations_of_ours_to(WITHIN * best.mean_px, contest)
    assert count is not None and count < POPULATION * GENERATIONS
    problem = contest.problem
    for generations in range(1, GENERATIONS + 1):
        shorter = replace(problem, schedule=replace(problem.schedule, generations=generations))
        found = run_slot(shorter, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
        if found.loss <= WITHIN * best.mean_px:
            break
    assert count == found.evaluations
    assert evaluations_of_ours_to(0.5 * best.mean_px, contest) is None


def test_a_peers_evaluations_are_counted_up_to_its_first_individual_below_the_target(race):
    rig, contest, best = race
    problem = contest.problem
    truth = (rig.truth - problem.lower) / (problem.upper - problem.lower)

    def run(watched):
        watched.losses(np.full((70, watched.genes), 0.5))
        for _ in range(5):
            watched.loss(np.full(watched.genes, 0.4))
        watched.losses(np.tile(truth, (3, 1)))
        watched.losses(np.tile(truth, (100, 1)))
        return Finish(truth, 178)

    peer = Peer("one", "python ga", "", run)
    assert evaluations_to(1.2 * best.mean_px, contest, peer) == 78
    assert evaluations_to(0.5 * best.mean_px, contest, peer) is None
