"""How a person holds the board over a recording: the roll's mean and spread, and which edge is where.

A recording's rolls spread about a mean of their own. Mean and spread are summed over a grid, with what is known of
boards in general as their prior; so boards that tell little, or no boards at all, leave what is known in general.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from workers.vertices.refined.board_model import Fix

Floats = NDArray[np.float64]
_LEAST_ROLL = math.radians(2.0)
_MEANS, _REACH, _SPREADS = 41, 2.8, 8
_SWAPPED = np.array([0.03, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97])
_STRAY = np.array([0.02, 0.1, 0.25, 0.5])


def learn_hold(fixes: Sequence[Fix], general: tuple[float, float]) -> tuple[tuple[float, float], float]:
    """Mean and standard deviation of the roll (radians from `hang`), and the share of sweeps with swapped edges.

    Each board's likelihood of its roll is taken for a Gaussian, the one whose product with the prior has the moments
    that were found. An unknown share of the boards, up to a half, are none: they tell nothing.

    Args:
        fixes: found with the prior ``general`` on the roll.
        general: mean and standard deviation over all recordings.
    """
    if not fixes:
        return general, 0.5
    middle, wide = general
    spread = np.geomspace(_LEAST_ROLL, wide, _SPREADS)[:, None]
    between = np.sqrt(np.maximum(wide**2 - spread**2, 1e-12))
    mean = middle + _REACH * np.linspace(-1.0, 1.0, _MEANS) * between  # (spreads, means)
    prior = -0.5 * ((mean - middle) / between) ** 2
    prior = prior - np.logaddexp.reduce(prior, axis=1, keepdims=True)
    evidence, roll, variance = np.moveaxis(np.array([fix.ways for fix in fixes]), -1, 0)[..., None, None]
    told = variance < 0.98 * wide**2
    own = np.where(told, 1.0 / np.maximum(1.0 / variance - 1.0 / wide**2, 1e-12), 1.0)
    at = middle + (roll - middle) * own / variance
    score = evidence + np.where(
        told, _normal(at, mean, own + spread**2) - _normal(at, middle, own + wide**2), 0.0
    )  # (boards, 2, spreads, means)
    share = np.log(np.stack([1.0 - _SWAPPED, _SWAPPED]))[:, :, None, None]
    held = np.logaddexp.reduce(score[:, :, None] + share, axis=1)  # (boards, shares, spreads, means)
    none = np.logaddexp.reduce(evidence + math.log(0.5), axis=1)[:, None]
    stray = _STRAY[:, None, None, None]
    likelihood = np.logaddexp(np.log1p(-stray) + held[:, None], np.log(stray) + none[:, None]).sum(axis=0) + prior
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    over_roll = weight.sum(axis=(0, 1))
    centre = float(np.sum(over_roll * mean))
    total = float(np.sum(over_roll * (spread**2 + (mean - centre) ** 2)))
    return (centre, math.sqrt(total)), float(weight.sum(axis=(0, 2, 3)) @ _SWAPPED)


def _normal(x: Floats, mean: Floats | float, variance: Floats) -> Floats:
    """Log density, without its constant."""
    return -0.5 * ((x - mean) ** 2 / variance + np.log(variance))
