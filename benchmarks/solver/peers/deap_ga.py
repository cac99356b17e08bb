"""DEAP's eaSimple, its map replaced by one compiled call per generation."""

import random
from typing import Any

import numpy as np
from deap import base, creator, tools
from deap.algorithms import varAnd

from benchmarks.solver.peers.contest import EVALUATIONS, POPULATION, Contest, Finish, Peer

_CROSSOVER, _MUTATION = 0.9, 0.2


def _run(contest: Contest) -> Finish:
    if not hasattr(creator, "ApexIndividual"):
        creator.create("ApexFitness", base.Fitness, weights=(-1.0,))
        creator.create("ApexIndividual", list, fitness=creator.ApexFitness)
    random.seed(contest.seed)
    box: Any = base.Toolbox()
    box.register("mate", tools.cxSimulatedBinaryBounded, eta=15.0, low=0.0, up=1.0)
    box.register("mutate", tools.mutPolynomialBounded, eta=20.0, low=0.0, up=1.0, indpb=1.0 / contest.genes)
    box.register("select", tools.selTournament, tournsize=3)
    make: Any = creator.ApexIndividual
    population = [make(random.random() for _ in range(contest.genes)) for _ in range(POPULATION)]
    hall, evaluations = tools.HallOfFame(1), 0
    # eaSimple, stopped by the number of evaluations: only individuals that changed are evaluated.
    while True:
        changed = [one for one in population if not one.fitness.valid]
        evaluations += len(changed)
        for one, loss in zip(changed, contest.losses(np.clip(changed, 0.0, 1.0)).tolist(), strict=True):
            one.fitness.values = (loss,)
        hall.update(population)
        if evaluations >= EVALUATIONS:
            return Finish(np.clip(hall[0], 0.0, 1.0), evaluations)
        population = varAnd(box.select(population, POPULATION), box, _CROSSOVER, _MUTATION)


PEERS = [
    Peer("DEAP eaSimple", "python ga", "tournaments of 3, SBX at 0.9, polynomial mutation at 0.2, bounded", _run)
]
