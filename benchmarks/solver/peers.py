# pyright: reportMissingImports=false
"""The searches of other libraries that come nearest: PyGAD's genetic algorithm, and the CMA-ES of cmaes.

docs/solver.md has the others that were raced. Each evaluates a generation in one compiled call.
"""

from typing import Any, Final

import numpy as np
import pygad
from cmaes import CMA

from benchmarks.solver.contest import EVALUATIONS, GENERATIONS, POPULATION, Contest, Floats

_CHILDREN: Final = 40


def _pygad(contest: Contest) -> Floats:
    ga: Any = pygad.GA(
        num_generations=GENERATIONS - 1, num_parents_mating=150, fitness_batch_size=POPULATION,
        fitness_func=lambda _, solutions, __: -contest.losses(np.clip(solutions, 0.0, 1.0)),
        sol_per_pop=POPULATION, num_genes=contest.genes, init_range_low=0.0, init_range_high=1.0, keep_elitism=8,
        crossover_type="uniform", mutation_type="random", random_mutation_min_val=-0.1, random_mutation_max_val=0.1,
        suppress_warnings=True, random_seed=contest.seed % 2**31,
    )  # fmt: skip
    ga.run()
    return np.asarray(ga.population[int(np.argmax(ga.last_generation_fitness))], dtype=np.float64)


def _cmaes(contest: Contest) -> Floats:
    genes = contest.genes
    method = CMA(
        mean=np.full(genes, 0.5), sigma=0.3, bounds=np.tile([0.0, 1.0], (genes, 1)), population_size=_CHILDREN,
        seed=contest.seed % 2**31,
    )  # fmt: skip
    best, lowest = np.full(genes, 0.5), np.inf
    for _ in range(EVALUATIONS // _CHILDREN):
        if method.should_stop():
            break
        children = [method.ask() for _ in range(_CHILDREN)]
        losses = contest.losses(children).tolist()
        index = int(np.argmin(losses))
        if losses[index] < lowest:
            best, lowest = children[index], losses[index]
        method.tell(list(zip(children, losses, strict=True)))
    return best


PEERS: Final = {"PyGAD": _pygad, "cmaes CMA-ES": _cmaes}
