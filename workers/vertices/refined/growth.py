"""How far outside of an edge beams still meet the board, and how gradually the hits end there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SOFT_DEG = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
BEAM_SIGMA_RAD = 1.5e-3  # data sheets: half of a beam of 3 mrad
GROWTH_RAD = (-0.25e-3, 10.0e-3)
_GROWTH_SIGMA_RAD = 0.5e-3


def usual_steps() -> Floats:
    """(K,) share of the sensors with each of the half widths `SOFT_DEG`, as data sheets tell: half of a beam."""
    widths = np.radians(SOFT_DEG)
    # The widths of the table are even in their logarithm.
    share: Floats = widths * np.exp(-0.5 * ((widths - BEAM_SIGMA_RAD) / BEAM_SIGMA_RAD) ** 2)
    return share / share.sum()


def any_growth(measured: float, sigma: float, widths: Floats) -> tuple[float, float]:
    """Growth and its standard deviation: what boards of known size tell, and what the step at the edges does.

    A beam whose middle is on the board lies on it for the most part. So the step from hits to misses begins at the
    edge or outside of it, and its middle lies as far out as half of its width, or farther. That half width is each of
    `SOFT_DEG` with shares ``widths`` (K,).
    """
    soft = np.radians(SOFT_DEG)
    spread = np.hypot(_GROWTH_SIGMA_RAD, 0.5 * soft)  # about the half width, before boards tell
    variance = spread**2 + sigma**2
    with np.errstate(divide="ignore"):
        log = np.log(widths) - 0.5 * ((measured - soft) ** 2 / variance + np.log(variance))
    share = np.exp(log - np.logaddexp.reduce(log))
    growth = np.clip(soft + spread**2 / variance * (measured - soft), *GROWTH_RAD)
    mean = float(share @ growth)
    return mean, math.sqrt(float(share @ ((spread * sigma) ** 2 / variance + (growth - mean) ** 2)))
