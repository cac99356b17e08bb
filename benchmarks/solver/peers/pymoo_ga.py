"""pymoo's genetic algorithm for real numbers, its problem vectorised: one compiled call per generation."""

from typing import Any

import numpy as np
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem
from pymoo.optimize import minimize

from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Finish, Peer


class _Fit(Problem):
    def __init__(self, contest: Contest) -> None:
        super().__init__(n_var=contest.genes, n_obj=1, xl=0.0, xu=1.0)
        self.contest = contest

    def _evaluate(self, x: Any, out: Any, *_: Any, **__: Any) -> None:
        out["F"] = self.contest.losses(x)[:, None]


def _run(contest: Contest) -> Finish:
    algorithm: Any = GA(pop_size=POPULATION, eliminate_duplicates=False)
    result: Any = minimize(
        _Fit(contest), algorithm, ("n_gen", GENERATIONS), seed=contest.seed, verbose=False, copy_algorithm=False
    )
    return Finish(np.asarray(result.X, dtype=np.float64), int(result.algorithm.evaluator.n_eval))


PEERS = [Peer("pymoo GA", "python ga", "SBX and polynomial mutation, its defaults; duplicates kept (faster)", _run)]
