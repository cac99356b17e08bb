"""How often the best test could notice a rolling shutter from the pairs."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from benchmarks.trust.judging import Judged
from workers.reports.checks import by_clock
from workers.reports.contents import estimate_of
from workers.reports.further_unknowns import tested


def shutter_power(found: Judged, line_time_us: float, *, offset_known: bool) -> float:
    """The share of draws of the marks' noise in which a line time would be noticed, from the stated covariance.

    The power of a two-sided test that accuses one of 200 cameras without it (decision 0052), linearised at the fit.
    ``offset_known``: the clocks' offset is not one more unknown.
    """
    estimate = estimate_of(found.fitted)
    moved = by_clock(estimate)
    late = 1e-6 * estimate.holding.rows_below[:, None] * moved
    result = tested(estimate, late[:, :, None] if offset_known else np.stack([late, moved], axis=2))
    if result is None:
        return 0.0
    shift = line_time_us / result.deviations[0]
    limit = norm.isf(0.0025)
    return float(norm.sf(limit - shift) + norm.cdf(-limit - shift))
