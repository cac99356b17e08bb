"""One rig's race: our slot, the bare evaluation of its own individuals, and every peer, one after the other."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Peer
from workers.geometry.models import MODEL_ID
from workers.solver.fitness import evaluate_population
from workers.solver.genetic import ELITE_FRACTION, PARENT_SHARE, SPREAD, evolve_recorded
from workers.solver.random_streams import stream_key
from workers.solver.slot import prior_rows, run_slot, scales_of
from workers.solver.stopping import flag_of

OURS = "apexcal"
REPEATS = 15


@dataclass(frozen=True)
class Time:
    """Processor seconds of a run, the loss it ended with in px, and how many individuals it evaluated."""

    seconds: float
    loss: float
    evaluations: int


def race(contest: Contest, peers: Sequence[Peer]) -> tuple[float, dict[str, Time]]:
    """Processor seconds of the bare evaluation, and each runner's time by name, ours under OURS."""
    problem = contest.problem
    low, high = problem.lower.tolist(), problem.upper.tolist()
    arguments, history = _recorded(contest)
    outcome, slot, bare = run_slot(problem, low, high, 0, 0), list[float](), list[float]()
    losses = np.empty(POPULATION, dtype=np.float32)
    stop = flag_of(problem.stop)
    _evaluate_again(history, int(POPULATION * ELITE_FRACTION), losses, stop, *arguments)
    for _ in range(REPEATS):
        began = time.process_time()
        run_slot(problem, low, high, 0, 0)
        between = time.process_time()
        _evaluate_again(history, int(POPULATION * ELITE_FRACTION), losses, stop, *arguments)
        slot.append(between - began)
        bare.append(time.process_time() - between)
    times = {OURS: Time(float(np.median(slot)), outcome.loss, outcome.evaluations)}
    for peer in peers:
        began = time.process_time()
        finish = peer.run(contest)
        seconds = time.process_time() - began + finish.elsewhere_s
        times[peer.name] = Time(seconds, contest.judge(finish), finish.evaluations)
    return float(np.median(bare)), times


def _recorded(contest: Contest) -> tuple[tuple[Any, ...], NDArray[np.float32]]:
    # What `evaluate_population` takes first, and every generation (G, F, P) of slot 0 as it was evaluated.
    p = contest.problem
    width = (p.upper - p.lower)[p.free]
    arguments = (
        MODEL_ID[p.model], 0, contest.pack, scales_of(p), p.lower.copy(), p.free, p.lower[p.free], width,
        prior_rows(p),
    )  # fmt: skip
    history = np.empty((GENERATIONS, contest.genes, POPULATION), dtype=np.float32)
    evolve_recorded(
        *arguments, POPULATION, GENERATIONS, PARENT_SHARE, SPREAD, stream_key(p, 0, 0),
        np.empty(contest.genes, dtype=np.float32), flag_of(p.stop), history,
    )  # fmt: skip
    return arguments, history


@njit(nogil=True, error_model="numpy", cache=True)
def _evaluate_again(
    history: Any, keep: int, losses: Any, stop: Any, model_id: int, form: int, pack: Any, scales: Any, base: Any,
    free: Any, lower: Any, width: Any, prior: Any,
) -> None:  # fmt: skip
    for generation in range(history.shape[0]):
        first = 0 if generation == 0 else keep
        evaluate_population(
            model_id, form, pack, scales, base, free, lower, width, prior, history[generation], losses, first,
            stop,
        )  # fmt: skip
