"""The genetic algorithm of one slot, compiled whole.

Truncation selection of parents, crossover along their covariance (their mean plus L z, L the Cholesky factor, with a
share of one parent kept), mutation of single genes, reflection at the bounds, and elitism. Textbook operators search
along the axes and stall on these strongly correlated parameters (docs/decisions/0014 and 0016).

Better parents weigh more in mean and covariance, by the logarithm of their rank, and the covariance is taken about
the mean of the parents before them, so that it is long in the direction in which the population moves: both are
Hansen's ("The CMA Evolution Strategy: A Tutorial", 2016).
"""

from math import log, sqrt
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.solver.fitness import evaluate_population
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


@njit(nogil=True, error_model="numpy", cache=True)
def select_best(losses: Singles, wanted: int, chosen: Indices) -> None:
    """Fill chosen[:wanted] with the indices of the `wanted` lowest losses (>= 0), in the order of their index.

    Bisection on the bits, which order like the numbers where none is negative: a few passes, no sort.
    """
    bits = losses.view(np.int32)
    low, high = np.int64(-1), np.int64(0x7F800000)
    while high - low > 1:
        middle = (low + high) >> 1
        pivot = np.int32(middle)
        count = np.int32(0)
        for i in range(bits.shape[0]):
            count += np.int32(1) if bits[i] <= pivot else np.int32(0)
        if count >= wanted:
            high = middle
        else:
            low = middle
    found = 0
    for i in range(bits.shape[0]):
        if bits[i] < high:
            chosen[found] = i
            found += 1
    for i in range(bits.shape[0]):
        if bits[i] == high and found < wanted:
            chosen[found] = i
            found += 1


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
        weights[np.argsort(losses, kind="mergesort")] = by_rank
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
    # All loops run from 0 over slices: an index that the compiler cannot see to be positive stops the vectors.
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
def evolve_recorded(
    model_id: int,
    form: int,
    pack: Singles,
    scales: Floats,
    base: Floats,
    free: Indices,
    lower: Floats,
    width: Floats,
    prior: Floats,
    size: int,
    generations: int,
    share: float,
    spread: float,
    key: np.uint64,
    best: Singles,
    stop: NDArray[np.uint8],
    history: Singles,
) -> int:
    """As `evolve`; and history (G, F, P) takes each of the first G generations as it was evaluated."""
    genes = free.shape[0]
    population = np.empty((genes, size), dtype=np.float32)
    losses = np.empty(size, dtype=np.float32)
    mu = min(size, max(int(size * PARENT_FRACTION), genes + 2))
    keep = max(1, int(size * ELITE_FRACTION))
    chosen, elite_at = np.empty(mu, dtype=np.int64), np.empty(keep, dtype=np.int64)
    parents = np.empty((genes, mu), dtype=np.float32)
    by_rank, weights = rank_weights(mu), np.empty(mu, dtype=np.float32)
    mean, shift = np.empty(genes, dtype=np.float32), np.empty(genes, dtype=np.float32)
    L = np.zeros((genes, genes))
    rows, quarter = (genes + 3) // 4 * 4, (size + 3) // 4
    factor = np.zeros((rows, rows), dtype=np.float32)
    quarters = np.zeros((rows, 4, quarter), dtype=np.float32)
    normals = quarters.reshape(rows, 4 * quarter)

    counter = 0
    mean[:] = 0.5
    for j in range(genes):
        fill_uniform(key, counter, population[j])
        counter += size
    evaluate_population(model_id, form, pack, scales, base, free, lower, width, prior, population, losses, 0, stop)
    if history.shape[0] > 0:
        history[0] = population
    evaluations = size
    for generation in range(1, generations):
        if stop[0] != 0:
            break
        select_best(losses, mu, chosen)
        parent_losses = losses[chosen]
        weigh_by_rank(parent_losses, by_rank, weights)
        gather_parents(population, chosen, weights, parents, mean, shift)
        cholesky_of_parents(parents, weights, shift, L)
        factor[:genes, :genes] = L * spread
        select_best(parent_losses, keep, elite_at)
        elite_at[:] = chosen[elite_at]
        elite, elite_losses = population[:, elite_at], losses[elite_at]
        for j in range(genes):
            fill_normal(key, counter, quarters[j])
            counter += quarter
        recombine(parents, mean, factor, normals, share, population, keep)
        mutate(key, counter, population, keep)
        counter += size
        population[:, :keep] = elite
        losses[:keep] = elite_losses
        evaluate_population(
            model_id, form, pack, scales, base, free, lower, width, prior, population, losses, keep, stop
        )
        evaluations += size - keep
        if generation < history.shape[0]:
            history[generation] = population
    best[:] = population[:, np.argmin(losses)]
    return evaluations


@njit(nogil=True, error_model="numpy", fastmath=False, cache=True)
def evolve(
    model_id: int,
    form: int,
    pack: Singles,
    scales: Floats,
    base: Floats,
    free: Indices,
    lower: Floats,
    width: Floats,
    prior: Floats,
    size: int,
    generations: int,
    share: float,
    spread: float,
    key: np.uint64,
    best: Singles,
    stop: NDArray[np.uint8],
) -> int:
    """Run one slot. Fills best (F,) with the best individual as fractions of the bounds; returns evaluations.

    The arguments are those of `evaluate_population`, then the population's size, the number of generations, the
    parent's share and the spread of the crossover, and the key of the random stream. Where another thread sets stop
    (1,) it returns within an evaluation or a generation's breeding, and what it filled means nothing.
    """
    nothing = np.empty((0, 0, 0), dtype=np.float32)
    return evolve_recorded(
        model_id, form, pack, scales, base, free, lower, width, prior, size, generations, share, spread, key, best,
        stop, nothing,
    )  # fmt: skip
