import numpy as np
import pytest

from tests.workers.solver.rigs import simulated
from workers.solver.fitness import loss_px
from workers.solver.genetic import cholesky_of_parents, gather_parents, rank_weights, recombine, weigh_by_rank
from workers.solver.slot import run_slot

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("count", [1, 7, 150, 1500])
def test_weights_follow_the_ranks_and_ties_go_to_the_lower_index(count):
    losses = RNG.integers(0, 40, count).astype(np.float32)
    by_rank, weights = rank_weights(count), np.empty(count, dtype=np.float32)
    assert by_rank.sum() == pytest.approx(1.0, abs=1e-5)
    assert (np.diff(by_rank) < 0).all()
    weigh_by_rank(losses, by_rank, weights)
    np.testing.assert_array_equal(weights[np.argsort(losses, kind="stable")], by_rank)


def test_the_covariance_is_about_the_mean_that_the_parents_moved_from():
    population = RNG.random((5, 60)).astype(np.float32)
    chosen, weights = RNG.permutation(60)[:20].astype(np.int64), rank_weights(20)
    before = np.full(5, 0.4, dtype=np.float32)
    mean, shift = before.copy(), np.empty(5, dtype=np.float32)
    parents, L = np.empty((5, 20), dtype=np.float32), np.zeros((5, 5))
    gather_parents(population, chosen, weights, parents, mean, shift)
    cholesky_of_parents(parents, weights, shift, L)
    off = population[:, chosen].astype(float) - before[:, None]
    np.testing.assert_allclose(L @ L.T, (weights * off) @ off.T, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(mean, population[:, chosen] @ weights, rtol=1e-5)


def test_children_are_the_mean_a_share_of_a_parent_and_the_drawn_part_inside_the_bounds():
    genes, size, mu, keep = 6, 50, 12, 3
    population = RNG.random((genes, size)).astype(np.float32)
    elders = population[:, :keep].copy()
    parents = (RNG.normal(size=(genes, mu)) * 0.3).astype(np.float32)
    mean, L, z = RNG.random(genes).astype(np.float32), np.zeros((8, 8), dtype=np.float32), np.zeros((8, 52))
    L[:genes, :genes] = np.tril(RNG.normal(size=(genes, genes)) * 0.3)
    z[:genes] = RNG.normal(size=(genes, 52))
    recombine(parents, mean, L, z.astype(np.float32), 0.5, population, keep)
    at = np.arange(size - keep)
    child = mean[:, None] + 0.5 * parents[:, at % mu] + (L @ z)[:genes, keep:size]
    child = np.abs(child)
    np.testing.assert_allclose(population[:, keep:], np.clip(np.minimum(child, 2.0 - child), 0.0, 1.0), atol=1e-5)
    np.testing.assert_array_equal(population[:, :keep], elders)


def test_one_slot_of_the_papers_size_ends_near_the_truths_loss():
    problem, truth = simulated("brown_conrady", 3, schedule={"population": 800, "generations": 30})
    found = run_slot(problem, problem.lower.tolist(), problem.upper.tolist(), 0, 0)
    assert found.loss < 1.05 * loss_px(problem, truth)
