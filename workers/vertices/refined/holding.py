"""How a person holds the board over a recording: mean and spread of roll and tilt, and which edge is where.

Each recording has its own mean and spread of roll and of tilt. Their posterior is summed over a grid; the prior is
what holds for boards in general. So boards with little information leave the general prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workers.vertices.refined.board_model import Fix

Floats = NDArray[np.float64]
Pair = tuple[float, float]
_LEAST_ROLL = math.radians(2.0)
_MEANS, _REACH, _SPREADS = 41, 2.8, 8
_SWAPPED = np.array([0.03, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97])
_STRAY = np.array([0.02, 0.1, 0.25, 0.5])
_NOTHING = 1e6
_TELLING = 0.98  # of the prior's variance; a board that leaves more carries no information


@dataclass(frozen=True, slots=True, eq=False)
class _Population:
    """The grid of a recording's possible means (S, M), spreads (S, 1) about them, and log priors."""

    mean: Floats
    spread: Floats
    prior: Floats

    def moments(self, weight: Floats) -> Pair:
        """Mean and standard deviation of the next board, with weights (S, M) that sum to 1."""
        centre = float(np.sum(weight * self.mean))
        return centre, math.sqrt(float(np.sum(weight * (self.spread**2 + (self.mean - centre) ** 2))))


def learn_roll(fixes: Sequence[Fix], general: Pair) -> tuple[Pair, float]:
    """Mean and standard deviation of the roll (radians from `hang`), and the share of sweeps with swapped edges.

    Args:
        fixes: found with the prior ``general`` on the roll.
        general: mean and standard deviation over all recordings.
    """
    if not fixes:
        return general, 0.5
    middle, wide = general
    spread = np.geomspace(_LEAST_ROLL, wide, _SPREADS)[:, None]
    between = np.sqrt(np.maximum(wide**2 - spread**2, 1e-12))
    mean = middle + _REACH * np.linspace(-1.0, 1.0, _MEANS) * between
    rolls = _Population(mean, spread, _normalised(-0.5 * ((mean - middle) / between) ** 2))
    evidence, value, variance = np.moveaxis(np.array([fix.ways for fix in fixes]), -1, 0)
    share = np.log(np.stack([1.0 - _SWAPPED, _SWAPPED]))
    at, own = _alone(value, variance, general)
    level = evidence - _normal(at, middle, own + wide**2)
    none = np.logaddexp.reduce(evidence - math.log(2.0), axis=1)
    weight = _weights(rolls, level, at, own, none, share)
    return rolls.moments(weight.sum(axis=0)), float(weight.sum(axis=(1, 2)) @ _SWAPPED)


def learn_slope(slope: Floats, variance: Floats, fitted_with: Pair, general: Pair, least: float) -> Pair:
    """Mean and standard deviation of a slope of the board's plane.

    Few recordings are far from the usual, but these can be very far. So the prior of the mean has the long tails of
    Student's t with three degrees of freedom.

    Args:
        slope, variance: (N,) of each board, found with the prior ``fitted_with``.
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
    at, own = _alone(slope, variance, fitted_with)
    level = np.zeros((slope.size, 1))
    # Legs and ground give any slope, also those of no board.
    none = _normal(at, np.clip(at, mean.min(), mean.max()), wide**2 + own)
    weight = _weights(slopes, level, at[:, None], own[:, None], none, np.zeros((1, 1)))
    return slopes.moments(weight[0])


def _alone(value: Floats, variance: Floats, prior: Pair) -> tuple[Floats, Floats]:
    """Value and variance without the prior that they were found with; the variance is infinite without information.

    The likelihood is approximated by the Gaussian whose product with the prior has the moments found.
    """
    middle, wide = prior
    told = variance < _TELLING * wide**2
    variance = np.where(told, variance, 0.5 * wide**2)
    own = 1.0 / (1.0 / variance - 1.0 / wide**2)
    return middle + (value - middle) * own / variance, np.where(told, own, _NOTHING)


def _weights(population: _Population, level: Floats, at: Floats, own: Floats, none: Floats, share: Floats) -> Floats:
    """(H, S, M) posterior weights; an unknown share of the boards, up to a half, are false and carry no information.

    Args:
        level, at, own: (N, W) log of the scale, mean and variance of each board's likelihood in each way to hold it.
        none: (N,) its log likelihood if it is false.
        share: (W, H) logs of how often each way is taken, for each of H cases.
    """
    level, at, own = (part[..., None, None] for part in (level, at, own))
    score = level + _normal(at, population.mean, own + population.spread**2)  # (N, W, S, M)
    held = np.logaddexp.reduce(score[:, :, None] + share[:, :, None, None], axis=1)  # (N, H, S, M)
    stray = _STRAY[:, None, None, None]
    each = np.logaddexp(np.log1p(-stray) + held[:, None], np.log(stray) + none[:, None, None, None, None])
    total = each.sum(axis=0) + population.prior
    weight = np.exp(total - total.max()).sum(axis=0)
    return weight / weight.sum()


def _normalised(log: Floats) -> Floats:
    return log - np.logaddexp.reduce(log, axis=1, keepdims=True)


def _normal(x: Floats, mean: Floats | float, variance: Floats) -> Floats:
    """Log density, without its constant."""
    return -0.5 * ((x - mean) ** 2 / variance + np.log(variance))
