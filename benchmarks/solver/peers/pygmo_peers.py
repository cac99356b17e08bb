"""pygmo's simple genetic algorithm and CMA-ES: C++, with our compiled evaluation as callback.

CMA-ES asks for a generation at a time, or for one individual; the simple genetic algorithm can only do the latter.
"""

from functools import partial
from typing import Any

import numpy as np
import pygmo

from benchmarks.solver.peers.contest import EVALUATIONS, GENERATIONS, POPULATION, Contest, Finish, Peer

_LAMBDA = 40


class _Fit:
    def __init__(self, contest: Contest) -> None:
        self.contest = contest

    def __deepcopy__(self, memo: object) -> "_Fit":
        # pygmo takes a copy of what it is given; evaluations are counted in the one contest.
        return self

    def fitness(self, x: Any) -> tuple[float]:
        return (self.contest.loss(x),)

    def batch_fitness(self, x: Any) -> Any:
        return self.contest.losses(np.asarray(x).reshape(-1, self.contest.genes))

    def get_bounds(self) -> tuple[list[float], list[float]]:
        return [0.0] * self.contest.genes, [1.0] * self.contest.genes


def _evolve(contest: Contest, method: Any, size: int) -> Finish:
    seed = contest.seed % 2**31
    population: Any = pygmo.population(pygmo.problem(_Fit(contest)), size=size, seed=seed)
    population = pygmo.algorithm(method).evolve(population)
    return Finish(np.asarray(population.champion_x, dtype=np.float64), int(population.problem.get_fevals()))


def _sga(contest: Contest) -> Finish:
    method = pygmo.sga(
        gen=GENERATIONS - 1, cr=0.9, eta_c=10.0, m=0.1, param_m=20.0, crossover="sbx", mutation="polynomial",
        selection="tournament", seed=contest.seed % 2**31,
    )  # fmt: skip
    return _evolve(contest, method, POPULATION)


def _cmaes(contest: Contest, batches: bool) -> Finish:
    method = pygmo.cmaes(
        gen=EVALUATIONS // _LAMBDA - 1, sigma0=0.3, ftol=1e-12, xtol=1e-12, force_bounds=True,
        seed=contest.seed % 2**31,
    )  # fmt: skip
    if batches:
        method.set_bfe(pygmo.bfe())
    return _evolve(contest, method, _LAMBDA)


PEERS = [
    Peer("pygmo sga", "compiled ga", "tournament, SBX at 0.9, polynomial mutation of a tenth of the genes", _sga),
    *(
        Peer(
            f"pygmo CMA-ES, {each}",
            "evolution strategy",
            f"lambda {_LAMBDA}, sigma 0.3, inside the bounds",
            partial(_cmaes, batches=each == "batches"),
        )
        for each in ("batches", "single")
    ),
]
