"""The cmaes library's CMA-ES, its generations evaluated in one compiled call each."""

import numpy as np
from cmaes import CMA

from benchmarks.solver.peers.contest import EVALUATIONS, Contest, Finish, Peer

_LAMBDA = 40


def _run(contest: Contest) -> Finish:
    genes = contest.genes
    method = CMA(
        mean=np.full(genes, 0.5), sigma=0.3, bounds=np.tile([0.0, 1.0], (genes, 1)), population_size=_LAMBDA,
        seed=contest.seed % 2**31,
    )  # fmt: skip
    best, lowest, evaluations = np.full(genes, 0.5), np.inf, 0
    while evaluations + _LAMBDA <= EVALUATIONS and not method.should_stop():
        asked = [method.ask() for _ in range(_LAMBDA)]
        losses = contest.losses(asked).tolist()
        evaluations += _LAMBDA
        at = int(np.argmin(losses))
        if losses[at] < lowest:
            best, lowest = asked[at], losses[at]
        method.tell(list(zip(asked, losses, strict=True)))
    return Finish(best, evaluations)


PEERS = [Peer("cmaes CMA-ES", "evolution strategy", f"lambda {_LAMBDA}, sigma 0.3, inside the bounds", _run)]
