"""Crossover operators of the literature, compiled alike, around the house's own evaluation and elitism.

0 textbook: two tournament parents, scattered genes, Gaussian mutation that shrinks (the released toolbox's kind).
1 blend: BLX-0.5 of two tournament parents (Eshelman and Schaffer 1993).
2 simplex: SPX of n + 1 parents (Tsutsui, Yamamura and Higuchi 1999).
3 parent-centric: PCX of three parents (Deb, Anand and Joshi 2002).
4 unimodal normal: UNDX of three parents (Ono and Kobayashi 1997).
5 covariance: mean and covariance of the best, all alike, about their own mean (docs/decisions/0016).
6 moving covariance: what the product does (`workers.solver.genetic`), here for an equal footing.
2 to 6 take their parents from the best 150 of 800, each with the same chance.
"""

from math import log, sqrt
from typing import Any

import numpy as np
from numba import njit

from apexcal.documents.schedules import Schedule
from workers.solver.fitness import Fitness, evaluate_population
from workers.solver.genetic import (
    ELITE_FRACTION,
    PARENT_FRACTION,
    PARENT_SHARE,
    SPREAD,
    Found,
    cholesky_of_parents,
    gather_parents,
    mutate,
    rank_weights,
    recombine,
    select_best,
    weigh_by_rank,
)
from workers.solver.random_streams import draw, fill_normal, fill_uniform
from workers.solver.slot import Search
from workers.solver.stopping import Stop

OPERATORS = ("textbook", "blend", "simplex", "parent_centric", "unimodal_normal", "covariance", "moving_covariance")


@njit(nogil=True, error_model="numpy", cache=True)
def _tournament(losses: Any, bits: np.uint64) -> int:
    size = np.uint64(losses.shape[0])
    a = np.int64((bits >> np.uint64(32)) % size)
    b = np.int64((bits & np.uint64(0xFFFFFFFF)) % size)
    return a if losses[a] <= losses[b] else b


@njit(nogil=True, error_model="numpy", cache=True)
def _two_parents(
    operator: int,
    key: np.uint64,
    counter: int,
    old: Any,
    losses: Any,
    normals: Any,
    progress: float,
    new: Any,
    keep: int,
) -> None:
    genes, size = old.shape
    for i in range(keep, size):
        a = _tournament(losses, draw(key, np.uint64(counter + 2 * i)))
        b = _tournament(losses, draw(key, np.uint64(counter + 2 * i + 1)))
        mutant = operator == 0 and i % 5 == 0
        for j in range(genes):
            r = np.float32(draw(key, np.uint64(counter + 2 * size + i * genes + j)) >> np.uint64(40)) * np.float32(
                2**-24
            )
            p, q = old[j, a], old[j, b]
            if operator == 1:
                new[j, i] = p + (q - p) * (np.float32(2.0) * r - np.float32(0.5))
            elif mutant:
                new[j, i] = p + np.float32(1.0 - progress) * normals[j, i]
            else:
                new[j, i] = p if r < 0.5 else q


@njit(nogil=True, error_model="numpy", cache=True)
def _many_parents(
    operator: int, key: np.uint64, counter: int, old: Any, chosen: Any, normals: Any, new: Any, keep: int
) -> None:
    genes, size = old.shape
    mu = np.uint64(chosen.shape[0])
    weights = np.empty(genes + 1)
    picks = np.empty(genes + 1, dtype=np.int64)
    d, e, z = np.empty(genes), np.empty(genes), np.empty(genes)
    stride = 2 * (genes + 1)
    for i in range(keep, size):
        at = counter + i * stride
        for k in range(genes + 1 if operator == 2 else 3):
            picks[k] = chosen[np.int64((draw(key, np.uint64(at + k)) >> np.uint64(11)) % mu)]
        if operator == 2:
            total = 0.0
            for k in range(genes + 1):
                u = (np.float64(draw(key, np.uint64(at + genes + 1 + k)) >> np.uint64(11)) + 0.5) * 2.0**-53
                weights[k] = -log(u)
                total += weights[k]
            stretch = sqrt(genes + 1.0)
            for j in range(genes):
                mean = child = 0.0
                for k in range(genes + 1):
                    mean += old[j, picks[k]]
                    child += weights[k] * old[j, picks[k]]
                mean /= genes + 1.0
                new[j, i] = np.float32(mean + stretch * (child / total - mean))
            continue
        # The primary direction, and how far the third parent lies off it.
        length = across = 0.0
        for j in range(genes):
            p, q, r = old[j, picks[0]], old[j, picks[1]], old[j, picks[2]]
            d[j] = p - 0.5 * (q + r) if operator == 3 else q - p
            e[j] = (q if operator == 3 else r) - p
            length += d[j] * d[j]
            across += d[j] * e[j]
        share = across / length if length > 0.0 else 0.0
        distance = along = 0.0
        for j in range(genes):
            rest = e[j] - share * d[j]
            distance += rest * rest
            z[j] = normals[j, i]
            along += z[j] * d[j]
        distance = sqrt(distance)
        along = along / length if length > 0.0 else 0.0
        step = normals[(i * 7) % genes, (i * 13 + 5) % size]
        sigma, spread = (0.1, 0.1) if operator == 3 else (0.5, 0.35 / sqrt(genes))
        for j in range(genes):
            centre = old[j, picks[0]] if operator == 3 else 0.5 * (old[j, picks[0]] + old[j, picks[1]])
            new[j, i] = np.float32(centre + sigma * step * d[j] + spread * distance * (z[j] - along * d[j]))


@njit(nogil=True, error_model="numpy", cache=True)
def evolve_with(
    operator: int, total_distances: Any, fitness: Any, size: int, generations: int, key: np.uint64, best: Any
) -> None:
    """As `workers.solver.genetic.evolve`, with one of OPERATORS; best (F,) takes the best individual."""
    genes = best.shape[0]
    population, old = np.empty((genes, size), dtype=np.float32), np.empty((genes, size), dtype=np.float32)
    rows, quarter = (genes + 3) // 4 * 4, (size + 3) // 4
    quarters, losses = np.zeros((rows, 4, quarter), dtype=np.float32), np.empty(size, dtype=np.float32)
    normals, factor = quarters.reshape(rows, 4 * quarter), np.zeros((rows, rows), dtype=np.float32)
    mu, keep = max(int(size * PARENT_FRACTION), genes + 2), max(1, int(size * ELITE_FRACTION))
    chosen, parents = np.empty(mu, dtype=np.int64), np.empty((genes, mu), dtype=np.float32)
    mean, shift = np.full(genes, np.float32(0.5)), np.empty(genes, dtype=np.float32)
    by_rank, weights = rank_weights(mu), np.full(mu, np.float32(1.0 / mu))
    L, spread = np.zeros((genes, genes)), SPREAD if operator == 6 else 1.0
    go_on = np.zeros(1, dtype=np.uint8)
    elite, elite_losses = np.empty((genes, keep), dtype=np.float32), np.empty(keep, dtype=np.float32)
    counter = 0
    for j in range(genes):
        fill_uniform(key, counter, population[j])
        counter += size
    evaluate_population(total_distances, fitness, population, losses, 0, go_on)
    for generation in range(1, generations):
        select_best(losses, keep, chosen)
        for i in range(keep):
            elite_losses[i] = losses[chosen[i]]
            for j in range(genes):
                elite[j, i] = population[j, chosen[i]]
        for j in range(genes):
            fill_normal(key, counter, quarters[j])
            counter += size
        select_best(losses, mu, chosen)
        if operator >= 5:
            if operator == 6:
                weigh_by_rank(losses[chosen], by_rank, weights)
            gather_parents(population, chosen, weights, parents, mean, shift)
            if operator == 5:
                shift[:] = 0.0
            cholesky_of_parents(parents, weights, shift, L)
            factor[:genes, :genes] = L * spread
            recombine(parents, mean, factor, normals, PARENT_SHARE, population, keep)
        else:
            old[:] = population
            if operator < 2:
                progress = generation / generations
                _two_parents(operator, key, counter, old, losses, normals, progress, population, keep)
            else:
                _many_parents(operator, key, counter, old, chosen, normals, population, keep)
            counter += size * (2 * genes + 4)
            _reflect(population, keep)
        if operator != 0:
            mutate(key, counter, population, keep)
        counter += size
        population[:, :keep] = elite
        losses[:keep] = elite_losses
        evaluate_population(total_distances, fitness, population, losses, keep, go_on)
    best[:] = population[:, np.argmin(losses)]


@njit(nogil=True, error_model="numpy", cache=True)
def _reflect(population: Any, keep: int) -> None:
    # At 0 and at 1, once each, as the product's crossover does for itself.
    for j in range(population.shape[0]):
        for i in range(keep, population.shape[1]):
            value = abs(population[j, i])
            population[j, i] = min(max(min(value, np.float32(2.0) - value), np.float32(0.0)), np.float32(1.0))


def searching_with(operator: int) -> Search:
    """One of OPERATORS, as a slot searches."""

    def search(fitness: Fitness, schedule: Schedule, key: np.uint64, stop: Stop) -> Found:
        best = np.empty(fitness.genes, dtype=np.float32)
        evolve_with(
            operator, fitness.total_distances, fitness.data, schedule.population, schedule.generations, key, best
        )
        return Found(best, 0)

    return search
