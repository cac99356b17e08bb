"""What every peer is given: a fit, and our compiled evaluation of it, of a whole population or of one individual."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.geometry.models import ModelName
from workers.geometry.projections.single_precision import Box, Targets
from workers.geometry.projections.table import PROJECTIONS
from workers.solver.fitness import Fitness, fitness_of, loss_px
from workers.solver.problem import FitProblem

Floats = NDArray[np.float64]
POPULATION, GENERATIONS = 800, 30
EVALUATIONS = POPULATION * GENERATIONS

Family = Literal["python ga", "compiled ga", "jax ga", "octave ga", "differential evolution", "evolution strategy"]


class PeerMissingError(Exception):
    """A peer that cannot be raced here."""


@dataclass(frozen=True)
class Finish:
    """A peer's best individual as fractions (F,) of the bounds, and how many it had evaluated.

    `elsewhere_s`: processor seconds that it took in other processes. `trace`: numbers of evaluations and the lowest
    loss by then, px, of a peer that does not call back.
    """

    best: Floats
    evaluations: int
    elsewhere_s: float = 0.0
    trace: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class Peer:
    """`run` is timed, after once unmeasured; of a `slow` one only its first rig. `settings` says how it is set up."""

    name: str
    family: Family
    settings: str
    run: "Callable[[Contest], Finish]"
    slow: bool = False


@dataclass(frozen=True, eq=False)
class Contest:
    """A fit without locks or priors, in the rotation vector's form. Individuals are fractions of its bounds."""

    problem: FitProblem
    seed: int
    fitness: Fitness = field(init=False)
    numbers: Floats = field(init=False)

    def __post_init__(self) -> None:
        problem = self.problem
        assert len(problem.free) == len(problem.names), "the peers' contest knows no locks"
        assert problem.loss == "mean", "the peers' contest knows no saturation"
        fitness = fitness_of(problem, problem.lower, problem.upper)
        data = fitness.data
        head = [data.targets.diagonal_px, data.per_weight]
        object.__setattr__(self, "fitness", fitness)
        object.__setattr__(self, "numbers", np.concatenate([head, data.box.lower, data.box.width]))

    @property
    def pack(self) -> NDArray[np.float32]:
        """The pairs as the kernels have them."""
        return self.fitness.data.targets.pack

    @property
    def genes(self) -> int:
        return len(self.problem.free)

    def losses(self, individuals: Any) -> Floats:
        """Losses (P,) of individuals (P, F), all in one compiled call."""
        columns = np.ascontiguousarray(np.asarray(individuals, dtype=np.float32).T)
        out = np.empty(columns.shape[1], dtype=np.float32)
        _losses_of(self.problem.model)(columns, self.pack, self.numbers, out)
        return out.astype(np.float64)

    def loss(self, individual: Floats) -> float:
        """Loss of one individual (F,), for peers that ask for one at a time."""
        return _loss_of(self.problem.model)(individual, self.pack, self.numbers)

    def parameters(self, individual: Floats) -> Floats:
        """Parameters (F,) of an individual, in the order of `problem.names`."""
        lower, upper = self.problem.lower, self.problem.upper
        return lower + (upper - lower) * np.clip(individual, 0.0, 1.0)

    def judge(self, finish: Finish) -> float:
        """The loss of a peer's best in px, in double precision, as the product states it."""
        return loss_px(self.problem, self.parameters(finish.best))


@cache
def _losses_of(model: ModelName) -> Callable[[Any, Any, Any, Any], None]:
    # A peer that asks for one individual at a time pays for every argument: so few, and the model's kernel called
    # directly.
    total_distances_into = PROJECTIONS[model].total_distances_into

    @njit(nogil=True, error_model="numpy")
    def losses(columns: Any, pack: Any, numbers: Any, out: Any) -> None:
        genes = columns.shape[0]
        box = Box(np.zeros(genes), np.arange(genes), numbers[2 : 2 + genes], numbers[2 + genes :])
        targets = Targets(0, pack, np.float32(numbers[0]), np.float32(0.0))
        total_distances_into(box, targets, columns, out, 0, np.zeros(1, dtype=np.uint8))
        for n in range(columns.shape[1]):
            out[n] *= numbers[1]

    return losses


@cache
def _loss_of(model: ModelName) -> Callable[[Any, Any, Any], float]:
    losses = _losses_of(model)

    @njit(nogil=True, error_model="numpy")
    def loss(individual: Any, pack: Any, numbers: Any) -> float:
        column, out = np.empty((individual.shape[0], 1), dtype=np.float32), np.empty(1, dtype=np.float32)
        column[:, 0] = individual
        losses(column, pack, numbers, out)
        return float(out[0])

    return loss
