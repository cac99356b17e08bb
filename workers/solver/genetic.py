"""The genetic algorithm of one slot, compiled whole.

Truncation selection of parents, crossover along the covariance of the parents (their mean plus L z, L the Cholesky
factor, with a share of one parent kept), mutation of single genes, reflection at the bounds, and elitism. Textbook
operators search along the axes and stall on these strongly correlated parameters.
"""

from math import sqrt
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.solver.fitness import evaluate_population
from workers.solver.random_streams import draw, fill_normal, fill_uniform

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

PARENT_FRACTION: Final = 150.0 / 800.0
ELITE_FRACTION: Final = 8.0 / 800.0
PARENT_SHARE: Final = 0.5
"""How much of its one parent's deviation from the mean a child keeps; the rest of its variance is drawn anew."""
SPREAD: Final = 1.0
"""Stretch of the drawn part. Above 1 it counteracts the narrowing that selection brings, and is slower."""
MUTANT_EVERY: Final = 16
_F0: Final = np.float32(0.0)
_F1: Final = np.float32(1.0)
_F2: Final = np.float32(2.0)


@njit(nogil=True, error_model="numpy", cache=True)
def select_best(losses: Singles, wanted: int, chosen: NDArray[np.int64]) -> None:
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


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract"}, cache=True)
def _gather_parents(population: Singles, chosen: NDArray[np.int64], parents: Singles, mean: Singles) -> None:
    # parents (F, mu) become deviations from their mean.
    mu = parents.shape[1]
    share = np.float32(1.0 / mu)
    for j in range(parents.shape[0]):
        row = parents[j]
        total = _F0
        for i in range(mu):
            row[i] = population[j, chosen[i]]
        for i in range(mu):
            total += row[i]
        mean[j] = total * share
        for i in range(mu):
            row[i] -= mean[j]


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract"}, cache=True)
def _dot(a: Singles, b: Singles) -> np.float32:
    total = _F0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@njit(nogil=True, error_model="numpy", cache=True)
def _cholesky_of_parents(parents: Singles, L: Floats) -> None:
    # L L^T = covariance of the deviations, with a floor on the diagonal so that a collapsed gene stays a number.
    n, mu = parents.shape
    for i in range(n):
        for j in range(i + 1):
            total = float(_dot(parents[i], parents[j])) / mu
            if i == j:
                total = total * (1.0 + 1e-6) + 1e-16
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = sqrt(max(total, 1e-16))
            else:
                L[i, j] = total / L[j, j]


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _recombine(
    parents: Singles,
    mean: Singles,
    L: Floats,
    normals: Singles,
    share: float,
    spread: float,
    population: Singles,
    keep: int,
) -> None:
    count = population.shape[1]
    mu = parents.shape[1]
    kept = np.float32(share)
    for j in range(parents.shape[0]):
        row = population[j]
        source = parents[j]
        # Every parent in turn: each has nearly the same number of children.
        for start in range(keep, count, mu):
            for i in range(min(mu, count - start)):
                row[start + i] = mean[j] + kept * source[i]
        for k in range(j + 1):
            factor = np.float32(L[j, k] * spread)
            z = normals[k]
            for i in range(keep, count):
                row[i] += factor * z[i]


@njit(nogil=True, error_model="numpy", cache=True)
def _mutate(key: np.uint64, first: int, population: Singles, keep: int) -> None:
    # One gene of every MUTANT_EVERY-th child goes anywhere in its bounds.
    genes = np.uint64(population.shape[0])
    for i in range(keep, population.shape[1], MUTANT_EVERY):
        bits = draw(key, np.uint64(first + i))
        gene = np.int64((bits >> np.uint64(40)) % genes)
        population[gene, i] = np.float32(np.int32(bits & np.uint64(0xFFFFFF))) * np.float32(2.0**-24)


@njit(nogil=True, error_model="numpy", cache=True)
def _reflect(population: Singles, keep: int) -> None:
    # At 0 and at 1, once each; whatever still is outside stops at the bound.
    for j in range(population.shape[0]):
        row = population[j]
        for i in range(keep, population.shape[1]):
            value = abs(row[i])
            value = min(value, _F2 - value)
            row[i] = min(max(value, _F0), _F1)


@njit(nogil=True, error_model="numpy", cache=True)
def evolve(
    model_id: int,
    form: int,
    pack: Singles,
    scales: Floats,
    base: Floats,
    free: NDArray[np.int64],
    lower: Floats,
    width: Floats,
    prior: Floats,
    size: int,
    generations: int,
    share: float,
    spread: float,
    key: np.uint64,
    best: Singles,
) -> int:
    """Run one slot. Fills best (F,) with the best individual as fractions of the bounds; returns evaluations.

    The arguments are those of `evaluate_population`, then the population's size, the number of generations, the
    parent's share and the spread of the crossover, and the key of the random stream.
    """
    genes = free.shape[0]
    population = np.empty((genes, size), dtype=np.float32)
    losses = np.empty(size, dtype=np.float32)
    normals = np.empty((genes, size), dtype=np.float32)
    mu = min(size, max(int(size * PARENT_FRACTION), genes + 2))
    keep = max(1, int(size * ELITE_FRACTION))
    chosen = np.empty(mu, dtype=np.int64)
    elite = np.empty((genes, keep), dtype=np.float32)
    elite_losses = np.empty(keep, dtype=np.float32)
    parents = np.empty((genes, mu), dtype=np.float32)
    mean = np.empty(genes, dtype=np.float32)
    L = np.zeros((genes, genes))

    counter = 0
    for j in range(genes):
        fill_uniform(key, counter, population[j])
        counter += size
    evaluate_population(model_id, form, pack, scales, base, free, lower, width, prior, population, losses, 0)
    evaluations = size
    for _ in range(1, generations):
        select_best(losses, mu, chosen)
        _gather_parents(population, chosen, parents, mean)
        _cholesky_of_parents(parents, L)
        select_best(losses, keep, chosen)
        for i in range(keep):
            elite_losses[i] = losses[chosen[i]]
            for j in range(genes):
                elite[j, i] = population[j, chosen[i]]
        for j in range(genes):
            fill_normal(key, counter, normals[j])
            counter += size
        _recombine(parents, mean, L, normals, share, spread, population, keep)
        _mutate(key, counter, population, keep)
        counter += size
        _reflect(population, keep)
        population[:, :keep] = elite
        losses[:keep] = elite_losses
        evaluate_population(model_id, form, pack, scales, base, free, lower, width, prior, population, losses, keep)
        evaluations += size - keep
    best[:] = population[:, np.argmin(losses)]
    return evaluations
