"""The hold of a board over a recording: mean and spread of roll and lean, and which edge is lower left.

Each recording has its own mean and its own spread of roll and of lean, drawn from what people do in general (a
hierarchical model). Their posterior is summed over a grid. Boards that say little leave the general prior as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.model import ROLLS

Floats = NDArray[np.float64]
Pair = tuple[float, float]
_LEAST_ROLL = math.radians(2.0)
_MEANS, _REACH, _SPREADS = 41, 2.8, 8
_SWAPPED = np.array([0.03, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97])
_STRAY = np.array([0.02, 0.1, 0.25, 0.5])
_NOTHING = 1e6
_TELLING = 0.98  # of the prior's variance; a board whose posterior keeps more carries no information


@dataclass(frozen=True, slots=True, eq=False)
class _Population:
    """The grid of a recording's possible means (S, M), spreads (S, 1) about them, and log priors (S, M)."""

    mean: Floats
    spread: Floats
    prior: Floats

    def moments(self, weight: Floats) -> Pair:
        """Return mean and standard deviation of the next board, with weights (S, M) that sum to 1."""
        centre = float(np.sum(weight * self.mean))
        return centre, math.sqrt(float(np.sum(weight * (self.spread**2 + (self.mean - centre) ** 2))))


@dataclass(frozen=True, slots=True)
class Holding:
    """The hold of a recording's boards.

    Attributes:
        roll: mean and standard deviation of the next board's roll, radians from the rest angle.
        mean_sigma: radians, standard deviation of the mean of all rolls.
        swapped: share of the sweeps in which the second edge is the one to the lower left.
        evidence: log likelihood of all boards' rays, averaged over rolls and both modes.
        stray: share of the boards that no single mean explains, for instance if each hand holds them at its own
            angle.
    """

    roll: Pair
    mean_sigma: float
    swapped: float
    evidence: float
    stray: float


def learn_roll(grids: Floats, general: Pair) -> Holding:
    """Return how boards are held whose rays have the log likelihoods ``grids`` (N, 2, G).

    A board on few rings can have any roll within an interval, and hardly any outside. So each likelihood is summed as
    it is; a Gaussian of the same moments would draw the mean towards the usual roll.

    Args:
        grids: `HoldEstimate.roll_log_likelihood` of each board.
        general: mean and standard deviation of the roll over all recordings.
    """
    rolls, prior = _any_rolls(*general)
    step = ROLLS[1] - ROLLS[0]
    highest = grids.max(axis=(1, 2), keepdims=True)
    likely = np.exp(grids - highest)  # (N, W, G)
    # A false board has a roll of its own.
    none = 0.5 * step * likely.sum(axis=1) @ _density(ROLLS, *general)
    each = likely @ prior.reshape(-1, ROLLS.size).T / none[:, None, None]  # (N, W, S M)
    share = np.stack([1.0 - _SWAPPED, _SWAPPED])
    likelihood = np.einsum("nwp,wh->nhp", each * step, share)
    stray = _STRAY[:, None, None, None]
    log = np.log((1.0 - stray) * likelihood + stray).sum(axis=1) + rolls.prior.ravel()  # (T, H, S M)
    total = float(np.logaddexp.reduce(log, axis=None))
    weight = np.exp(log - total)
    of_rolls = weight.sum(axis=(0, 1)).reshape(rolls.mean.shape)
    roll = rolls.moments(of_rolls)
    sigma = math.sqrt(float(np.sum(of_rolls * (rolls.mean - roll[0]) ** 2)))
    evidence = total + float(np.sum(np.log(none)) + highest.sum())
    swapped, strays = float(weight.sum(axis=(0, 2)) @ _SWAPPED), float(weight.sum(axis=(1, 2)) @ _STRAY)
    return Holding(roll, sigma, swapped, evidence, strays)


@cache
def _any_rolls(middle: float, wide: float) -> tuple[_Population, Floats]:
    """Return all means and spreads of rolls that a recording may have, and their densities (S, M, G) at `ROLLS`."""
    spread = np.geomspace(_LEAST_ROLL, wide, _SPREADS)[:, None]
    between = np.sqrt(np.maximum(wide**2 - spread**2, 1e-12))
    mean = middle + _REACH * np.linspace(-1.0, 1.0, _MEANS) * between
    prior = _normalised(-0.5 * ((mean - middle) / between) ** 2)
    return _Population(mean, spread, prior), _density(ROLLS, mean[..., None], spread[..., None])


def _density(x: Floats, mean: Floats | float, sigma: Floats | float) -> Floats:
    return np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))


def learn_slope(slope: Floats, variance: Floats, fitted_with: Pair, general: Pair, least: float) -> Pair:
    """Return mean and standard deviation of a slope of the board's plane over a recording.

    Few recordings are far from the usual, but these can be very far. So the prior of the mean has the long tails of
    Student's t with three degrees of freedom.

    Args:
        slope, variance: (N,) of each board, estimated with the prior ``fitted_with``.
        general: mean and standard deviation over all recordings.
        least: smallest possible spread.
    """
    if not slope.size:
        return general
    middle, wide = fitted_with
    spread = np.geomspace(least, wide, _SPREADS)[:, None]
    mean = np.broadcast_to(middle + _REACH * wide * np.linspace(-1.0, 1.0, _MEANS), (_SPREADS, _MEANS))
    usual = -2.0 * np.log1p((mean - general[0]) ** 2 / general[1] ** 2)
    slopes = _Population(mean, spread, _normalised(usual) - np.log(spread))
    at, own = _without_prior(slope, variance, fitted_with)
    # Legs and ground have any slope, also slopes that no board has.
    none = _normal(at, np.clip(at, mean.min(), mean.max()), wide**2 + own)
    log_density = _normal(at[:, None, None], slopes.mean, own[:, None, None] + slopes.spread**2)
    stray = _STRAY[:, None, None, None]
    each = np.logaddexp(np.log1p(-stray) + log_density, np.log(stray) + none[:, None, None])
    total = each.sum(axis=1) + slopes.prior
    weight = np.exp(total - total.max()).sum(axis=0)
    return slopes.moments(weight / weight.sum())


def _without_prior(value: Floats, variance: Floats, prior: Pair) -> tuple[Floats, Floats]:
    """Return value and variance (N,) without the prior they were estimated with; infinite if they add nothing to it.

    The likelihood is approximated by the Gaussian whose product with the prior has the estimate's moments.
    """
    middle, wide = prior
    is_informed = variance < _TELLING * wide**2
    variance = np.where(is_informed, variance, 0.5 * wide**2)
    own = 1.0 / (1.0 / variance - 1.0 / wide**2)
    return middle + (value - middle) * own / variance, np.where(is_informed, own, _NOTHING)


def _normalised(log: Floats) -> Floats:
    return log - np.logaddexp.reduce(log, axis=1, keepdims=True)


def _normal(x: Floats, mean: Floats | float, variance: Floats) -> Floats:
    """Return the log density, without its constant."""
    return -0.5 * ((x - mean) ** 2 / variance + np.log(variance))
