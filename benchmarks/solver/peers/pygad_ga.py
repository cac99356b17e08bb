"""PyGAD, with its fitness in batches of a whole generation."""

from typing import Any

import numpy as np
import pygad

from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Finish, Peer


def _run(contest: Contest) -> Finish:
    evaluations = 0

    def fitness(_: Any, solutions: Any, __: Any) -> Any:
        nonlocal evaluations
        evaluations += len(solutions)
        return -contest.losses(np.clip(solutions, 0.0, 1.0))

    ga: Any = pygad.GA(
        num_generations=GENERATIONS - 1,
        num_parents_mating=150,
        fitness_func=fitness,
        fitness_batch_size=POPULATION,
        sol_per_pop=POPULATION,
        num_genes=contest.genes,
        init_range_low=0.0,
        init_range_high=1.0,
        keep_elitism=8,
        crossover_type="uniform",
        mutation_type="random",
        random_mutation_min_val=-0.1,
        random_mutation_max_val=0.1,
        suppress_warnings=True,
        random_seed=contest.seed % 2**31,
    )
    ga.run()
    # As a user asks for it: the last generation's best.
    best = np.asarray(ga.population[int(np.argmax(ga.last_generation_fitness))], dtype=np.float64)
    return Finish(np.clip(best, 0.0, 1.0), evaluations)


PEERS = [
    Peer(
        "PyGAD",
        "python ga",
        "best 150 as parents, uniform crossover, 10 % of genes moved by up to 0.1, 8 elites",
        _run,
    )
]
