import numpy as np

from tests.workers.solver.rigs import simulated
from workers.solver.fitness import loss_px
from workers.solver.genetic import (
    MUTANT_EVERY,
    breed,
    first_generation,
)
from workers.solver.slot import run_slot


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
