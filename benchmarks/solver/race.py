"""One rig's race: our slot, the bare evaluation of its own individuals, and every peer, one after the other."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Peer
from workers.solver.fitness import evaluate_population
from workers.solver.genetic import ELITE_FRACTION, breed, first_generation
from workers.solver.random_streams import stream_key
from workers.solver.slot import run_slot
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
    fitness, history = contest.fitness, _recorded(contest)
    outcome, slot, bare = run_slot(problem, low, high, 0, 0), list[float](), list[float]()
    losses = np.empty(POPULATION, dtype=np.float32)
    stop = flag_of(problem.stop)
    bare_arguments = (fitness.total_distances, fitness.data, history, int(POPULATION * ELITE_FRACTION), losses, stop)
    _evaluate_again(*bare_arguments)
    for _ in range(REPEATS):
        began = time.process_time()
        run_slot(problem, low, high, 0, 0)
        between = time.process_time()
        _evaluate_again(*bare_arguments)
        slot.append(between - began)
        bare.append(time.process_time() - between)
    times = {OURS: Time(float(np.median(slot)), outcome.loss, outcome.evaluations)}
    for peer in peers:
        began = time.process_time()
        finish = peer.run(contest)
        seconds = time.process_time() - began + finish.elsewhere_s
        times[peer.name] = Time(seconds, contest.judge(finish), finish.evaluations)
    return float(np.median(bare)), times


def _recorded(contest: Contest) -> NDArray[np.float32]:
    # Every generation (G, F, P) of slot 0 as it was evaluated.
    p, fitness = contest.problem, contest.fitness
    generation, stop = first_generation(fitness.genes, POPULATION, stream_key(p, 0, 0)), flag_of(p.stop)
    history = np.empty((GENERATIONS, fitness.genes, POPULATION), dtype=np.float32)
    for number in range(GENERATIONS):
        if number:
            breed(generation)
        history[number] = generation.population
        first = len(generation.elite_losses) if number else 0
        evaluate_population(
            fitness.total_distances, fitness.data, generation.population, generation.losses, first, stop
        )
    return history


@njit(nogil=True, error_model="numpy", cache=True)
def _evaluate_again(total_distances: Any, fitness: Any, history: Any, keep: int, losses: Any, stop: Any) -> None:
    for generation in range(history.shape[0]):
        first = 0 if generation == 0 else keep
        evaluate_population(total_distances, fitness, history[generation], losses, first, stop)
