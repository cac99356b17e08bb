"""The evidence of held-out pairs for models: robust log likelihoods, their differences, and the models' weights.

A pair's error follows a Gaussian, or with a small probability it lies anywhere in the image. So the cost of a wrong
mark or of a missing projection is bounded. Pairs that the best model rejects count equally little for every model.
Both parts are fitted to each model's own held-out errors. Weights: pseudo Bayesian model averaging with the Bayesian
bootstrap (Yao, Vehtari, Simpson and Gelman 2018), over blocks, because the pairs of a block err together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Real marks are no better than this (as in workers/solver/covariances.py).
_FLOOR_PX: Final = 0.1
_ROUNDS: Final = 200
_DRAWS: Final = 2000


@dataclass(frozen=True, eq=False)
class Pairs:
    """A model's errors on N pairs, in the order of their numbers.

    ``number`` of the pair in its set, ``block`` that it was held out with, ``standard_px`` its distance in px of a
    typical pair, ``stretch`` how that scales lengths, ``errors_px`` the plain distance.
    """

    number: Integers
    block: Integers
    standard_px: Floats
    stretch: Floats
    errors_px: Floats

    def of(self, numbers: Integers) -> Pairs:
        """Only the pairs with these numbers."""
        is_common = np.isin(self.number, numbers)
        return Pairs(*(getattr(self, name)[is_common] for name in self.__dataclass_fields__))


class Evidence(NamedTuple):
    """For each model the log likelihoods of pairs, their total, and its weight; ``best`` is the likeliest model.

    ``belongs`` (N,): the probability under the best model that the pair is no wrong mark; totals count pairs by it.
    ``sigma_px``: each model's noise per coordinate, without wrong marks.
    """

    best: str
    log_likelihood: dict[str, Floats]
    total: dict[str, float]
    weight: dict[str, float]
    belongs: Floats
    sigma_px: dict[str, float]

    def behind(self, model: str, block: Integers) -> tuple[float, float]:
        """Return by how much the best model's total is higher, and the standard error of this over the blocks."""
        difference = self.belongs * (self.log_likelihood[self.best] - self.log_likelihood[model])
        return float(difference.sum()), standard_error(difference, block)


def evidence_of_models(models: Mapping[str, Pairs], area_px2: float) -> Evidence:
    """Return the evidence of models on the same pairs. ``area_px2``: of the image; wrong marks lie anywhere in it."""
    parts = {name: _mixture(pairs, area_px2) for name, pairs in models.items()}
    best = max(parts, key=lambda name: float(parts[name].log_likelihood.sum()))
    belongs = parts[best].belongs
    log_likelihood = {name: part.log_likelihood for name, part in parts.items()}
    total = {name: float(belongs @ of_pair) for name, of_pair in log_likelihood.items()}
    best = max(total, key=lambda name: total[name])
    block = next(iter(models.values())).block
    sums = np.array([_sums(belongs * of_pair, block) for of_pair in log_likelihood.values()])
    weight = dict(zip(models, _weights(sums), strict=True))
    return Evidence(
        best, log_likelihood, total, weight, belongs, {name: part.sigma_px for name, part in parts.items()}
    )


def standard_error(values: Floats, block: Integers) -> float:
    """Standard error of the sum of values (N,) that vary together in each block."""
    sums = _sums(values, block)
    count = len(sums)
    return float(np.sqrt(count / max(count - 1, 1) * np.sum((sums - sums.mean()) ** 2)))


class _Mixture(NamedTuple):
    log_likelihood: Floats
    belongs: Floats
    sigma_px: float


def _mixture(pairs: Pairs, area_px2: float) -> _Mixture:
    """Gaussian errors and a share of marks anywhere, by expectation and maximisation (Dempster and others 1977)."""
    square, anywhere = pairs.standard_px**2, 1.0 / area_px2
    count = len(square)
    # Of a Gaussian in the plane the median square is 2 ln 2 sigma^2.
    variance = max(float(np.median(square)) / (2.0 * np.log(2.0)), _FLOOR_PX**2)
    share = 1.0 / count
    for _ in range(_ROUNDS):
        belongs = _gaussian(square, pairs.stretch, variance, share)
        belongs = belongs / (belongs + share * anywhere)
        before = variance, share
        variance = max(float(belongs @ square) / (2.0 * max(float(belongs.sum()), 1e-300)), _FLOOR_PX**2)
        # Adding one pair that lies anywhere bounds the share below, and so any error's cost.
        share = (count - float(belongs.sum()) + 1.0) / (count + 1.0)
        if abs(variance - before[0]) <= 1e-9 * variance and abs(share - before[1]) <= 1e-9:
            break
    gaussian = _gaussian(square, pairs.stretch, variance, share)
    whole = gaussian + share * anywhere
    return _Mixture(np.log(whole), gaussian / whole, float(np.sqrt(variance)))


def _gaussian(square: Floats, stretch: Floats, variance: float, share: float) -> Floats:
    exponent = np.minimum(square / (2.0 * variance), 700.0)
    return (1.0 - share) * stretch**2 * np.exp(-exponent) / (2.0 * np.pi * variance)


def _sums(values: Floats, block: Integers) -> Floats:
    _, index = np.unique(block, return_inverse=True)
    return np.bincount(index, weights=values).astype(np.float64)


def _weights(sums: Floats) -> list[float]:
    models, blocks = sums.shape
    if models == 1:
        return [1.0]
    # Fixed seed: a calibration is judged alike whichever process ends it.
    shares = np.random.default_rng(0).dirichlet(np.ones(blocks), _DRAWS) * blocks
    totals = shares @ sums.T
    likelihood = np.exp(totals - totals.max(axis=1, keepdims=True))
    return np.mean(likelihood / likelihood.sum(axis=1, keepdims=True), axis=0).tolist()
