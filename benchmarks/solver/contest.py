"""A fit that every search is given with our compiled evaluation of it; and our slot beside that evaluation alone."""

import time
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.solver.fitness import evaluate_population, fitness_of, loss_px
from workers.solver.genetic import ELITE_FRACTION, breed, first_generation
from workers.solver.outcomes import flag_of
from workers.solver.problem import FitProblem
from workers.solver.random_streams import stream_key
from workers.solver.slot import run_slot

Floats = NDArray[np.float64]
POPULATION: Final = 800
GENERATIONS: Final = 30
EVALUATIONS: Final = POPULATION * GENERATIONS
_REPEATS: Final = 15


class Contest:
    """A fit without locks or priors. Individuals are fractions of its bounds, ``genes`` numbers each."""

    def __init__(self, problem: FitProblem, seed: int) -> None:
        self.problem, self.seed = problem, seed
        self.fitness = fitness_of(problem, problem.lower, problem.upper)
        self.genes = self.fitness.genes

    def losses(self, individuals: Any) -> Floats:
        """Losses (P,) of individuals (P, F) in px, all in one compiled call."""
        columns = np.ascontiguousarray(np.asarray(individuals, dtype=np.float32).T)
        out, fitness = np.empty(columns.shape[1], dtype=np.float32), self.fitness
        evaluate_population(fitness.total_distances, fitness.data, columns, out, 0, flag_of(self.problem.stop))
        return out.astype(np.float64)

    def judge(self, best: Floats) -> float:
        """The loss of an individual in px, in double precision, as the product states it."""
        lower, upper = self.problem.lower, self.problem.upper
        return loss_px(self.problem, lower + (upper - lower) * np.clip(best, 0.0, 1.0))


class SlotTimes(NamedTuple):
    """Processor seconds of a slot and of the bare evaluation of its individuals; the slot's loss (px)."""

    slot_s: float
    bare_s: float
    loss: float


def time_slot(contest: Contest) -> SlotTimes:
    """Medians of interleaved repeats."""
    problem, fitness = contest.problem, contest.fitness
    low, high = problem.lower.tolist(), problem.upper.tolist()
    loss = run_slot(problem, low, high, 0, 0).loss
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
    return SlotTimes(float(np.median(slot_s)), float(np.median(bare_s)), loss)


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
