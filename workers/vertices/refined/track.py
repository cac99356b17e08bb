"""What the sweeps before and after tell of the board's roll and place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def roll_from_neighbours(
    seconds: Floats, roll: Floats, sigma: Floats, mean: float, spread: float, *, length_s: float, extra: float
) -> tuple[float, float]:
    """Roll at time 0 from the posteriors of other sweeps, by Gaussian-process regression.

    Args:
        seconds: (N,) times of the neighbours; roll, sigma: (N,) radians, their posteriors under the prior.
        mean, spread: the prior under which they were made.
        length_s: correlation length of a hand-held board's roll.
        extra: radians, floor of the answer's standard deviation.
    """
    precision = 1.0 / sigma**2 - 1.0 / spread**2
    told = precision > 0.1 / spread**2
    if not told.any():
        return mean, spread
    seconds, precision = seconds[told], precision[told]
    own = (roll[told] / sigma[told] ** 2 - mean / spread**2) / precision - mean
    between = spread**2 * np.exp(-0.5 * ((seconds[:, None] - seconds[None, :]) / length_s) ** 2)
    towards = spread**2 * np.exp(-0.5 * (seconds / length_s) ** 2)
    gain = np.linalg.solve(between + np.diag(1.5 / precision), towards)
    variance = spread**2 - float(gain @ towards)
    return mean + float(gain @ own), float(np.sqrt(max(variance, 0.0) + extra**2))
