"""The excess of a value over its surroundings, in deviations of these: the same rule for points and for pixels."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_MAD: Final = 1.4826
# A median of fewer values is no background.
_FEWEST: Final = 10


def local_excess(position: Floats, value: Floats, window: float, floor: float) -> Floats:
    """(N,) excess of values over their running median, in robust deviations of the window.

    Medians are of windows that overlap by half and are interpolated in between. What fills less than half of a window
    hardly moves its median.

    Args:
        position: (N,), ascending, in the unit of `window`.
        value: (N,).
        window: its length.
        floor: the smallest deviation that counts, for quantised values.

    Returns:
        NaN where the windows hold too few values.
    """
    excess = np.full(len(value), np.nan)
    if len(value) < _FEWEST:
        return excess
    centres = np.arange(position[0], position[-1] + window / 2, window / 2)
    first = np.searchsorted(position, centres - window / 2)
    last = np.searchsorted(position, centres + window / 2)
    layers = [
        (centre, *_middle(value[a:b])) for centre, a, b in zip(centres, first, last, strict=True) if b - a >= _FEWEST
    ]
    if not layers:
        return excess
    at, middle, spread = np.array(layers).T
    near = np.abs(position - at[np.abs(position[:, None] - at).argmin(axis=1)]) <= window
    background = np.asarray(np.interp(position, at, middle), np.float64)
    deviation = np.maximum(np.asarray(np.interp(position, at, spread), np.float64), floor)
    excess[near] = ((value - background) / deviation)[near]
    return excess


def _middle(values: Floats) -> tuple[float, float]:
    middle = float(np.median(values))
    return middle, _MAD * float(np.median(np.abs(values - middle)))
