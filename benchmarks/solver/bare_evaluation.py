"""Our slot beside the bare evaluation of its own individuals."""

import time
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.solver.contest import GENERATIONS, POPULATION, Contest
from workers.solver.fitness import evaluate_population
from workers.solver.genetic import ELITE_FRACTION, breed, first_generation
from workers.solver.outcomes import flag_of
from workers.solver.random_streams import stream_key
from workers.solver.slot import run_slot

_REPEATS: Final = 15


class SlotTimes(NamedTuple):
    """Processor seconds of a slot and of the bare evaluation; the slot's loss (px) and evaluations."""

    slot_s: float
    bare_s: float
    loss: float
    evaluations: int


def time_slot(contest: Contest) -> SlotTimes:
    """Medians of interleaved repeats."""
    problem, fitness = contest.problem, contest.fitness
    low, high = problem.lower.tolist(), problem.upper.tolist()
    outcome = run_slot(problem, low, high, 0, 0)
    losses, keep = np.empty(POPULATION, dtype=np.float32), int(POPULATION * ELITE_FRACTION)
    bare = (fitness.total_distances, fitness.data, _generations(contest), keep, losses, flag_of(problem.stop))
    _evaluate_again(*bare)
    slot_s, bare_s = list[float](), list[float]()
    for _ in range(_REPEATS):
        began = time.process_time()
        run_slot(problem, low, high, 0, 0)
        between = time.process_time()
        _evaluate_again(*bare)
        slot_s.append(between - began)
        bare_s.append(time.process_time() - between)
    return SlotTimes(float(np.median(slot_s)), float(np.median(bare_s)), outcome.loss, outcome.evaluations)


def _generations(contest: Contest) -> NDArray[np.float32]:
    """Every generation (G, F, P) of slot 0 as it was evaluated."""
    problem, fitness = contest.problem, contest.fitness
    generation = first_generation(fitness.genes, POPULATION, stream_key(problem, 0, 0))
    history = np.empty((GENERATIONS, fitness.genes, POPULATION), dtype=np.float32)
    for number in range(GENERATIONS):
        if number:
            breed(generation)
        history[number] = generation.population
        first = len(generation.elite_losses) if number else 0
        evaluate_population(
            *(fitness.total_distances, fitness.data, generation.population, generation.losses, first),
            flag_of(problem.stop),
        )
    return history


@njit(nogil=True, error_model="numpy", cache=True)
def _evaluate_again(total_distances: Any, fitness: Any, history: Any, keep: int, losses: Any, stop: Any) -> None:
    for generation in range(history.shape[0]):
        first = 0 if generation == 0 else keep
        evaluate_population(total_distances, fitness, history[generation], losses, first, stop)
