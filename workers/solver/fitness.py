"""The losses of a search's individuals: compiled, in single precision, vectorised over the pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numba.core.types import CompileResultWAP
from numpy.typing import NDArray

from workers.geometry.models import FORM_ID
from workers.geometry.projection import distances_px
from workers.geometry.projections.single_precision import Box, Targets, place_individual
from workers.geometry.projections.table import PROJECTIONS
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict
from workers.solver.weighting import search_weights

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

LANES: Final = 32
"""The pairs are padded to full vectors: 32 covers two of the widest vectors of today's processors."""
_WORST: Final = np.float32(3.0e38)


class FitnessData(NamedTuple):
    """A problem and the searched bounds as the kernels take them, by D parameters.

    per_weight: 1 / sum of weights. prior_mean, prior_strength (D,): mean and 1 / sigma, 0 where there is none.
    prior_share: px that a prior's squared score of 1 adds to the loss; 0 if no parameter has a prior.
    """

    box: Box
    targets: Targets
    per_weight: float
    prior_mean: Floats
    prior_strength: Floats
    prior_share: float


@dataclass(frozen=True, eq=False)
class Fitness:
    """A search's loss as one object: the model's kernel, its data, and the upper bounds (F,) of the free parameters.

    weights (N,): of the problem's pairs.
    """

    problem: FitProblem
    weights: Floats
    total_distances: CompileResultWAP
    data: FitnessData
    upper: Floats

    @property
    def genes(self) -> int:
        """Return the number of free parameters."""
        return len(self.upper)

    def parameters(self, fractions: Singles) -> Floats:
        """Return the parameter vector (D,) of an individual (F,)."""
        box = self.data.box
        p = box.base.copy()
        # lower + width may round past the upper bound.
        placed = box.lower + box.width * fractions.astype(np.float64)
        p[box.free] = np.minimum(np.maximum(placed, box.lower), self.upper)
        return p

    def loss_px(self, p: Floats) -> float:
        """Return the loss that the search minimises, at p (D,), in pixels and double precision, priors included."""
        problem, data = self.problem, self.data
        pixels, violation = predict(problem, p)
        d = distances_px(pixels, violation, problem.pixels, problem.diagonal_px)
        if problem.loss == "saturating":
            d = d / (1.0 + d / problem.saturation_px)
        off = (p - data.prior_mean) * data.prior_strength
        # Sums in index order whatever the BLAS, so that the bits are the same everywhere.
        return float((self.weights * d).sum() * data.per_weight + data.prior_share * (off * off).sum())


def fitness_of(problem: FitProblem, lower: Floats, upper: Floats) -> Fitness:
    """Return the loss of a problem for a search inside [lower, upper] (D,)."""
    free, base = problem.free, problem.lower
    weights, sigma_px = search_weights(problem)
    bend = 1.0 / problem.saturation_px if problem.loss == "saturating" else 0.0
    pack = pack_pairs(problem, weights)
    targets = Targets(FORM_ID[problem.search], pack, np.float32(problem.diagonal_px), np.float32(bend))
    box = Box(base, free, lower[free], (upper - lower)[free])
    total = float(np.sum(weights))
    # The mean distance is a Laplacian's log-likelihood per pair; a Gaussian prior adds z^2 / 2 in the same units,
    # for marks whose mean distance is sqrt(pi / 2) sigma_px.
    prior_share = 0.5 * sqrt(np.pi / 2.0) * sigma_px / total if problem.priors else 0.0
    data = FitnessData(box, targets, 1.0 / total, *prior_rows(problem), prior_share)
    return Fitness(problem, weights, PROJECTIONS[problem.model].total_distances_pointer, data, upper[free])


def loss_px(problem: FitProblem, parameters: Sequence[float] | Floats) -> float:
    """Return `Fitness.loss_px` of a problem inside its own bounds."""
    return fitness_of(problem, problem.lower, problem.upper).loss_px(np.asarray(parameters, dtype=np.float64))


def pack_pairs(problem: FitProblem, weights: Floats) -> Singles:
    """Return the pairs with these weights (N,), as `Targets.pack` packs them."""
    n = len(problem.points)
    pack = np.empty((6, (n + LANES - 1) // LANES * LANES), dtype=np.float32)
    pack[:3, :n] = problem.turned_points.T
    pack[3:5, :n] = problem.pixels.T
    pack[5, :n] = weights
    pack[:5, n:] = pack[:5, n - 1 : n]
    pack[5, n:] = 0.0
    return pack


def prior_rows(problem: FitProblem) -> tuple[Floats, Floats]:
    """(D,) mean and 1 / sigma of each parameter's prior, 0 where there is none or it is locked."""
    mean, strength = np.zeros(len(problem.names)), np.zeros(len(problem.names))
    for name, (value, sigma) in problem.priors.items():
        if name in problem.names and name not in problem.locked:
            index = problem.names.index(name)
            mean[index], strength[index] = value, 1.0 / sigma
    return mean, strength


@njit(nogil=True, error_model="numpy", cache=True)
def evaluate_population(
    total_distances: Any,
    fitness: FitnessData,
    population: Singles,
    losses: Singles,
    first: int,
    stop: NDArray[np.uint8],
) -> None:
    """Fill losses (P,) in pixels of the individuals of population (F, P) from `first` on.

    total_distances: the model's `Projection.total_distances_pointer`. It is an argument of its own because numba's
    support of functions in tuples is experimental. stop (1,): read before each individual; once another thread has
    set it, the losses mean nothing.
    """
    base, free, lower, width = fitness.box
    prior_mean, prior_strength, prior_share = fitness.prior_mean, fitness.prior_strength, fitness.prior_share
    total_distances(fitness.box, fitness.targets, population, losses, first, stop)
    p = base.copy()
    for n in range(first, population.shape[1]):
        loss = losses[n] * fitness.per_weight
        if prior_share > 0.0:
            place_individual(free, lower, width, population, n, p)
            for j in range(p.shape[0]):
                off = (p[j] - prior_mean[j]) * prior_strength[j]
                loss += prior_share * off * off
        # Written so that NaN is the worst of all losses too.
        losses[n] = np.float32(loss) if loss < _WORST else _WORST
