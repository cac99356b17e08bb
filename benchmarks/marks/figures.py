"""Counts with their intervals."""

from __future__ import annotations

import numpy as np
from scipy import stats


def share(count: int, total: int) -> str:
    """A share with its count and 95 % interval (Clopper and Pearson 1934)."""
    if total == 0:
        return "none of 0"
    low = 0.0 if count == 0 else float(stats.beta.ppf(0.025, count, total - count + 1))
    high = 1.0 if count == total else float(stats.beta.ppf(0.975, count + 1, total - count))
    return f"{count / total:.3f} [{low:.3f}, {high:.3f}] ({count} of {total})"


def quantiles(values: list[float]) -> str:
    """Median and ninth decile."""
    if not values:
        return "none"
    return "median {:.2f}, 90 % {:.2f}".format(*np.quantile(values, [0.5, 0.9]))
