"""What every peer is given: a fit, and our compiled evaluation of it, of a whole population or of one individual."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.geometry.models import MODEL_ID
from workers.solver.fitness import evaluate_population
from workers.solver.problem import FitProblem
from workers.solver.slot import loss_px, pack_pairs, scales_of

Floats = NDArray[np.float64]
POPULATION, GENERATIONS = 800, 30
EVALUATIONS = POPULATION * GENERATIONS

Family = Literal["python ga", "compiled ga", "jax ga", "octave ga", "differential evolution", "evolution strategy"]


class PeerMissingError(Exception):
    """A peer that cannot be raced here."""


@dataclass(frozen=True)
class Finish:
    """A peer's best individual as fractions (F,) of the bounds, and how many it had evaluated.

    `elsewhere_s`: processor seconds that it took in other processes.
    """

    best: Floats
    evaluations: int
    elsewhere_s: float = 0.0


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
    pack: NDArray[np.float32] = field(init=False)
    numbers: Floats = field(init=False)

    def __post_init__(self) -> None:
        problem = self.problem
        assert len(problem.free) == len(problem.names), "the peers' contest knows no locks"
        head = [float(MODEL_ID[problem.model]), *scales_of(problem)]
        object.__setattr__(self, "pack", pack_pairs(problem))
        object.__setattr__(
            self, "numbers", np.concatenate([head, problem.lower, problem.upper - problem.lower]).astype(np.float64)
        )

    @property
    def genes(self) -> int:
        return len(self.problem.free)

    def losses(self, individuals: Any) -> Floats:
        """Losses (P,) of individuals (P, F), all in one compiled call."""
        columns = np.ascontiguousarray(np.asarray(individuals, dtype=np.float32).T)
        out = np.empty(columns.shape[1], dtype=np.float32)
        _losses(columns, self.pack, self.numbers, out)
        return out.astype(np.float64)

    def loss(self, individual: Floats) -> float:
        """Loss of one individual (F,), for peers that ask for one at a time."""
        return _loss(individual, self.pack, self.numbers)

    def parameters(self, individual: Floats) -> Floats:
        """Parameters (F,) of an individual, in the order of `problem.names`."""
        lower, upper = self.problem.lower, self.problem.upper
        return lower + (upper - lower) * np.clip(individual, 0.0, 1.0)

    def judge(self, finish: Finish) -> float:
        """The loss of a peer's best in px, in double precision, as the product states it."""
        return loss_px(self.problem, self.parameters(finish.best))


@njit(nogil=True, error_model="numpy", cache=True)
def _losses(columns: Any, pack: Any, numbers: Any, out: Any) -> None:
    genes = columns.shape[0]
    lower, width = numbers[5 : 5 + genes], numbers[5 + genes :]
    evaluate_population(
        int(numbers[0]), 0, pack, numbers[1:5], lower, np.arange(genes), lower, width, np.zeros((2, genes)), columns,
        out, 0, np.zeros(1, dtype=np.uint8),
    )  # fmt: skip


@njit(nogil=True, error_model="numpy", cache=True)
def _loss(individual: Any, pack: Any, numbers: Any) -> float:
    column, out = np.empty((individual.shape[0], 1), dtype=np.float32), np.empty(1, dtype=np.float32)
    column[:, 0] = individual
    _losses(column, pack, numbers, out)
    return float(out[0])
