"""SciPy's differential evolution, vectorised: one compiled call per generation."""

from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Finish, Peer


def _run(contest: Contest) -> Finish:
    rng = np.random.default_rng(contest.seed)
    # With `vectorized` it counts calls, each of a whole generation.
    result: Any = differential_evolution(
        lambda x: contest.losses(x.T),
        [(0.0, 1.0)] * contest.genes,
        init=rng.random((POPULATION, contest.genes)),
        maxiter=GENERATIONS - 1,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )
    return Finish(np.asarray(result.x, dtype=np.float64), int(result.nfev) * POPULATION)


PEERS = [Peer("SciPy differential evolution", "differential evolution", "best1bin, its defaults, no polish", _run)]
