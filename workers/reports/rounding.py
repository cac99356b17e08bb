"""Numbers as a report holds them: six digits, null for what is none."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_DIGITS: Final = 6


def rounded(values: NDArray[np.float64] | Iterable[float]) -> list[float | None]:
    """The numbers as JSON has them."""
    return [float(f"{value:.{_DIGITS}g}") if isfinite(value) else None for value in np.asarray(values).tolist()]


def tidy(value: Any) -> Any:
    """A document with all its numbers rounded and without numbers that JSON lacks."""
    if isinstance(value, dict):
        return {str(name): tidy(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [tidy(item) for item in value]
    if isinstance(value, np.ndarray):
        return tidy(value.tolist())
    if isinstance(value, float | np.floating):
        return rounded([float(value)])[0]
    return int(value) if isinstance(value, np.integer) else value
