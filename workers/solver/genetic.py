"""The genetic algorithm of one slot, compiled whole.

Truncation selection of parents, crossover along their covariance (their mean plus L z, L the Cholesky factor, with a
share of one parent kept), mutation of single genes, reflection at the bounds, and elitism. Textbook operators search
along the axes and stall on these strongly correlated parameters (docs/decisions/0016).

Better parents weigh more in mean and covariance, by the logarithm of their rank, and the covariance is taken about
the mean of the parents before them, so that it is long in the direction in which the population moves: both are
Hansen's ("The CMA Evolution Strategy: A Tutorial", 2016).
"""

from math import log, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from apexcal.documents.schedules import Schedule
from workers.solver.fitness import Fitness, FitnessData, evaluate_population
from workers.solver.outcomes import Stop, flag_of
from workers.solver.random_streams import draw, fill_normal, fill_uniform

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

PARENT_FRACTION: Final = 150.0 / 800.0
ELITE_FRACTION: Final = 8.0 / 800.0
PARENT_SHARE: Final = 0.5
"""How much of its one parent's deviation from the mean a child keeps; the rest of its variance is drawn anew."""
SPREAD: Final = 0.9
"""Stretch of the drawn part: more counteracts the narrowing that selection brings, and is slower."""
MUTANT_EVERY: Final = 16
_MANY_PARENTS: Final = 1024
_F0: Final = np.float32(0.0)
_F1: Final = np.float32(1.0)
_F2: Final = np.float32(2.0)


class SearchOutcome(NamedTuple):
    """The best individual of a search as fractions (F,) of the bounds, and how many were evaluated."""

    best: Singles
    evaluations: int


class Generation(NamedTuple):
    """The state of a search of P individuals of F genes, changed in place from generation to generation.

    key and counter (1,): the random stream, and how many of its draws are used. population (F, P), losses (P,):
    individuals as fractions of the bounds. The first K individuals of each generation but the first are the elite of
    the one before. The rest is what breeding works in: chosen (M,) are the parents' indices, parents (F, M) their
    deviations from mean (F,), which moved by shift (F,); L (F, F) is the Cholesky factor of their covariance, and
    factor and quarters hold it and the drawn numbers in the form that `recombine` wants.
    """

    key: np.uint64
    counter: Indices
    population: Singles
    losses: Singles
    chosen: Indices
    parent_losses: Singles
    by_rank: Singles
    weights: Singles
    parents: Singles
    mean: Singles
    shift: Singles
    L: Floats
    factor: Singles
    quarters: NDArray[np.float32]
    elite_at: Indices
    elite: Singles
    elite_losses: Singles


def genetic_search(fitness: Fitness, schedule: Schedule, key: np.uint64, stop: Stop) -> SearchOutcome:
    """Search as large as the schedule says. Where `stop` is set meanwhile, what was found means nothing."""
    generation = first_generation(fitness.genes, schedule.population, key)
    stop_flag = flag_of(stop)
    best, evaluations = evolve(fitness.total_distances, fitness.data, generation, schedule.generations, stop_flag)
    return SearchOutcome(generation.population[:, best].copy(), evaluations)


def first_generation(genes: int, size: int, key: np.uint64) -> Generation:
    """Individuals drawn uniformly, not yet evaluated."""
    mu = min(size, max(int(size * PARENT_FRACTION), genes + 2))
    keep = max(1, int(size * ELITE_FRACTION))
    rows, quarter = (genes + 3) // 4 * 4, (size + 3) // 4
    generation = Generation(
        key=key,
        counter=np.zeros(1, dtype=np.int64),
        population=np.empty((genes, size), dtype=np.float32),
        losses=np.empty(size, dtype=np.float32),
        chosen=np.empty(mu, dtype=np.int64),
        parent_losses=np.empty(mu, dtype=np.float32),
        by_rank=rank_weights(mu),
        weights=np.empty(mu, dtype=np.float32),
        parents=np.empty((genes, mu), dtype=np.float32),
        mean=np.full(genes, 0.5, dtype=np.float32),
        shift=np.empty(genes, dtype=np.float32),
        L=np.zeros((genes, genes)),
        factor=np.zeros((rows, rows), dtype=np.float32),
        quarters=np.zeros((rows, 4, quarter), dtype=np.float32),
        elite_at=np.empty(keep, dtype=np.int64),
        elite=np.empty((genes, keep), dtype=np.float32),
        elite_losses=np.empty(keep, dtype=np.float32),
    )
    fill_uniform(key, 0, generation.population.reshape(-1))
    generation.counter[0] = genes * size
    return generation


@njit(nogil=True, error_model="numpy", cache=True)
def select_best(losses: Singles, keep: int, chosen: Indices) -> None:
    """Fill chosen[:keep] with the indices of the `keep` lowest losses (>= 0), in the order of their index.

    It bisects the bits of the numbers, which have the same order as the numbers because none is negative. That takes
    a few passes and no sort. Indices of losses equal to the highest chosen one come last.
    """
    bits = losses.view(np.int32)
    least, most = bits[0], bits[0]
    for i in range(bits.shape[0]):
        least, most = min(least, bits[i]), max(most, bits[i])
    low, high = np.int64(least) - 1, np.int64(most)
    while high - low > 1:
        middle = (low + high) >> 1
        pivot = np.int32(middle)
        count = np.int32(0)
        for i in range(bits.shape[0]):
            count += np.int32(1) if bits[i] <= pivot else np.int32(0)
        if count >= keep:
            high = middle
        else:
            low = middle
        if count == keep:
            break
    highest, pivot = least, np.int32(high)
    for i in range(bits.shape[0]):
        highest = max(highest, bits[i] if bits[i] <= pivot else least)
    # Without a branch: every index is written, and the next one overwrites it if it does not count. Fewer than
    # `keep` lie below the highest, so `filled` stays below it.
    filled = 0
    for i in range(bits.shape[0]):
        chosen[filled] = i
        filled += 1 if bits[i] < highest else 0
    for i in range(bits.shape[0]):
        if bits[i] == highest and filled < keep:
            chosen[filled] = i
            filled += 1


@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def rank_weights(count: int) -> Singles:
    """Weights (count,) of parents by rank, the best first: log(count + 1/2) - log(rank), scaled to sum 1."""
    weights = np.empty(count)
    for i in range(count):
        weights[i] = log(count + 0.5) - log(i + 1.0)
    return (weights / np.sum(weights)).astype(np.float32)


@njit(nogil=True, error_model="numpy", cache=True)
def weigh_by_rank(losses: Singles, by_rank: Singles, weights: Singles) -> None:
    """Fill weights (n,) with by_rank (n,) at each loss's rank among losses (n,); ties rank by index."""
    n = losses.shape[0]
    if n > _MANY_PARENTS:
        order = np.argsort(losses, kind="mergesort")
        for i in range(n):
            weights[order[i]] = by_rank[i]
        return
    # For a few hundred, counting who is better runs in full vectors and costs less than a sort.
    for i in range(n):
        mine = losses[i]
        rank = np.int32(0)
        before, after = losses[:i], losses[i:]
        for k in range(before.shape[0]):
            rank += np.int32(1) if before[k] <= mine else np.int32(0)
        for k in range(after.shape[0]):
            rank += np.int32(1) if after[k] < mine else np.int32(0)
        weights[i] = by_rank[rank]


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract"}, cache=True)
def gather_parents(
    population: Singles, chosen: Indices, weights: Singles, parents: Singles, mean: Singles, shift: Singles
) -> None:
    """Fill parents (F, mu) with the chosen ones' deviations from their weighted mean (F,).

    shift (F,) becomes how far that mean has moved from what `mean` held before.
    """
    mu = parents.shape[1]
    for j in range(parents.shape[0]):
        row, source = parents[j], population[j]
        for i in range(mu):
            row[i] = source[chosen[i]]
        total = _F0
        for i in range(mu):
            total += weights[i] * row[i]
        for i in range(mu):
            row[i] -= total
        shift[j] = total - mean[j]
        mean[j] = total


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract"}, cache=True)
def _dot(a: Singles, b: Singles) -> np.float32:
    total = _F0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def cholesky_of_parents(parents: Singles, weights: Singles, shift: Singles, L: Floats) -> None:
    """Fill L (F, F), lower: L L^T is the weighted covariance of parents (F, mu) about the mean they moved from.

    About that mean it is the covariance about their own plus shift shift^T (Steiner). A floor on the diagonal keeps a
    collapsed gene a number.
    """
    n = parents.shape[0]
    weighed = np.empty(parents.shape[1], dtype=np.float32)
    for i in range(n):
        row = parents[i]
        for k in range(weighed.shape[0]):
            weighed[k] = weights[k] * row[k]
        for j in range(i + 1):
            total = float(_dot(weighed, parents[j])) + float(shift[i]) * float(shift[j])
            if i == j:
                total = total * (1.0 + 1e-6) + 1e-16
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = sqrt(max(total, 1e-16))
            else:
                L[i, j] = total / L[j, j]


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def recombine(
    parents: Singles, mean: Singles, L: Singles, normals: Singles, share: float, population: Singles, keep: int
) -> None:
    """Children into population (F, P) from column `keep` on: mean + share * a parent's deviation + L z, reflected.

    L (F4, F4) and normals (F4, >= P) have their rows, and L its columns, padded by zeros to a multiple of four.
    Reflection is at 0 and at 1, once each; whatever still is outside stops at the bound.
    """
    mu = parents.shape[1]
    size = population.shape[1]
    kept = np.float32(share)
    # All loops run from 0 over slices: an index whose sign the compiler cannot see prevents vectorisation.
    for j in range(parents.shape[0]):
        row, source, centre = population[j, keep:], parents[j], mean[j]
        # Every parent in turn: each has nearly the same number of children.
        for start in range(0, size - keep, mu):
            part = row[start : start + mu]
            for i in range(part.shape[0]):
                part[i] = centre + kept * source[i]
        for k in range(0, j + 1, 4):
            l0, l1, l2, l3 = L[j, k], L[j, k + 1], L[j, k + 2], L[j, k + 3]
            z0, z1 = normals[k, keep:size], normals[k + 1, keep:size]
            z2, z3 = normals[k + 2, keep:size], normals[k + 3, keep:size]
            for i in range(row.shape[0]):
                row[i] += l0 * z0[i] + l1 * z1[i] + l2 * z2[i] + l3 * z3[i]
        for i in range(row.shape[0]):
            value = abs(row[i])
            value = min(value, _F2 - value)
            row[i] = min(max(value, _F0), _F1)


@njit(nogil=True, error_model="numpy", cache=True)
def mutate(key: np.uint64, first: int, population: Singles, keep: int) -> None:
    """One gene of every MUTANT_EVERY-th child goes anywhere in its bounds; draws from number `first` on."""
    genes = np.uint64(population.shape[0])
    for i in range(keep, population.shape[1], MUTANT_EVERY):
        bits = draw(key, np.uint64(first + i))
        gene = np.int64((bits >> np.uint64(40)) % genes)
        population[gene, i] = np.float32(np.int32(bits & np.uint64(0xFFFFFF))) * np.float32(2.0**-24)


@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def breed(generation: Generation) -> None:
    """Replace an evaluated generation by the next: its elite with their losses, and children to be evaluated."""
    key, counter, population, losses = generation.key, generation.counter, generation.population, generation.losses
    chosen, parent_losses, weights = generation.chosen, generation.parent_losses, generation.weights
    parents, mean, shift = generation.parents, generation.mean, generation.shift
    L, factor, quarters = generation.L, generation.factor, generation.quarters
    elite_at, elite, elite_losses = generation.elite_at, generation.elite, generation.elite_losses
    genes, mu, keep = parents.shape[0], chosen.shape[0], elite_at.shape[0]
    rows, quarter = quarters.shape[0], quarters.shape[2]
    select_best(losses, mu, chosen)
    for i in range(mu):
        parent_losses[i] = losses[chosen[i]]
    weigh_by_rank(parent_losses, generation.by_rank, weights)
    gather_parents(population, chosen, weights, parents, mean, shift)
    cholesky_of_parents(parents, weights, shift, L)
    for i in range(genes):
        for j in range(genes):
            factor[i, j] = L[i, j] * SPREAD
    select_best(parent_losses, keep, elite_at)
    for i in range(keep):
        elite_losses[i] = parent_losses[elite_at[i]]
        for j in range(genes):
            elite[j, i] = population[j, chosen[elite_at[i]]]
    for j in range(genes):
        fill_normal(key, counter[0], quarters[j])
        counter[0] += quarter
    recombine(parents, mean, factor, quarters.reshape(rows, 4 * quarter), PARENT_SHARE, population, keep)
    mutate(key, counter[0], population, keep)
    counter[0] += population.shape[1]
    for i in range(keep):
        losses[i] = elite_losses[i]
        for j in range(genes):
            population[j, i] = elite[j, i]


@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def evolve(
    total_distances: Any, fitness: FitnessData, generation: Generation, generations: int, stop: NDArray[np.uint8]
) -> tuple[int, int]:
    """Evaluate and breed so many generations in place, the last one evaluated; the best one's index, and evaluations.

    The first two arguments are those of `evaluate_population`. Where another thread sets stop (1,) it returns within
    an evaluation or a generation's breeding, and what it filled means nothing.
    """
    size, keep = generation.losses.shape[0], generation.elite_losses.shape[0]
    evaluate_population(total_distances, fitness, generation.population, generation.losses, 0, stop)
    evaluations = size
    for _ in range(1, generations):
        if stop[0] != 0:
            break
        breed(generation)
        evaluate_population(total_distances, fitness, generation.population, generation.losses, keep, stop)
        evaluations += size - keep
    return int(np.argmin(generation.losses)), evaluations
