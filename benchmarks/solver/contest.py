"""A fit that every search is given with our compiled evaluation of it, and what is counted of a search."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.solver.fitness import Fitness, evaluate_population, fitness_of, loss_px
from workers.solver.outcomes import flag_of
from workers.solver.problem import FitProblem

Floats = NDArray[np.float64]
POPULATION: Final = 800
GENERATIONS: Final = 30
EVALUATIONS: Final = POPULATION * GENERATIONS


@dataclass(eq=False)
class Contest:
    """A fit without locks or priors. Individuals are fractions of its bounds.

    Attributes:
        evaluations: how many individuals were evaluated so far.
        trace: that number and the loss (px) whenever a lower loss was found.
    """

    problem: FitProblem
    seed: int
    fitness: Fitness = field(init=False)
    evaluations: int = 0
    trace: list[tuple[int, float]] = field(default_factory=list[tuple[int, float]])

    def __post_init__(self) -> None:
        self.fitness = fitness_of(self.problem, self.problem.lower, self.problem.upper)

    @property
    def genes(self) -> int:
        """How many numbers an individual has."""
        return self.fitness.genes

    def losses(self, individuals: Any) -> Floats:
        """Losses (P,) of individuals (P, F) in px, all in one compiled call."""
        columns = np.ascontiguousarray(np.asarray(individuals, dtype=np.float32).T)
        out, fitness = np.empty(columns.shape[1], dtype=np.float32), self.fitness
        evaluate_population(fitness.total_distances, fitness.data, columns, out, 0, flag_of(self.problem.stop))
        self.evaluations += len(out)
        lowest = float(out.min(initial=np.inf))
        if not self.trace or lowest < self.trace[-1][1]:
            self.trace.append((self.evaluations, lowest))
        return out.astype(np.float64)

    def evaluations_to(self, target_px: float) -> int | None:
        """How many evaluations it took to a loss at or below the target; None if none is."""
        return next((count for count, loss in self.trace if loss <= target_px), None)

    def judge(self, best: Floats) -> float:
        """The loss of an individual in px, in double precision, as the product states it."""
        lower, upper = self.problem.lower, self.problem.upper
        return loss_px(self.problem, lower + (upper - lower) * np.clip(best, 0.0, 1.0))


class Peer(NamedTuple):
    """A search of another library: its name, how it is set up, and what searches, which returns its best (F,)."""

    name: str
    settings: str
    run: Callable[[Contest], Floats]
