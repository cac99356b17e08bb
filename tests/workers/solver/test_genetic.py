import numpy as np
import pytest

from tests.workers.solver.rigs import simulated
from workers.solver.fitness import loss_px
from workers.solver.genetic import (
    MUTANT_EVERY,
    breed,
    cholesky_of_parents,
    first_generation,
    gather_parents,
    rank_weights,
    recombine,
    weigh_by_rank,
)
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


def test_each_sixteenth_child_of_a_collapsed_population_has_one_gene_from_anywhere():
    """Where all individuals are alike, recombination only repeats them: what is new comes from mutation."""
    genes, size = 7, 643
    generation = first_generation(genes, size, np.uint64(11))
    drawn = []
    for _ in range(20):
        generation.population[:] = np.float32(0.5)
        generation.mean[:] = np.float32(0.5)
        generation.losses[:] = np.float32(1.0)
        breed(generation)
        new = np.abs(generation.population - 0.5) > 1e-4
        children = np.arange(generation.elite_losses.shape[0], size)
        assert not new[:, : children[0]].any()
        assert set(np.flatnonzero(new.any(axis=0))) <= set(children[::MUTANT_EVERY])
        assert new.sum(axis=0).max() == 1
        drawn.append((np.nonzero(new)[0], generation.population[new]))
    which, value = (np.concatenate(column) for column in zip(*drawn, strict=True))
    count = 20 * len(children[::MUTANT_EVERY])
    assert len(which) > 0.99 * count  # one in 5,000 lands where it was
    # Each gene alike often, anywhere within its bounds: five standard deviations of a count and of a uniform mean.
    assert np.abs(np.bincount(which, minlength=genes) - count / genes).max() < 5.0 * np.sqrt(count / genes)
    assert abs(value.mean() - 0.5) < 5.0 / np.sqrt(12.0 * count) and value.min() < 0.01 and value.max() > 0.99
