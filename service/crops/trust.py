"""The worth of confirmations, by the shifted marks that people missed. Pure functions: no database.

A mark of the machine is wrong with probability p, by a shift like those that the pages show. Person i accepts a wrong
mark with probability m_i, the share of shifted marks that they missed. Both are posterior means under Jeffreys' prior
Beta(1/2, 1/2). Of the marks that people with m_1 ... m_k confirmed

    q = p m_1 ... m_k / (p m_1 ... m_k + 1 - p)

are wrong (Bayes), and a coordinate's variance is that of the mark plus q times that of a shift.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from service.crops.shifts import shift_px


@dataclass(frozen=True, slots=True)
class ShiftCount:
    """Counts of the shifted marks that a person was shown, and of those that they accepted."""

    shifted: int = 0
    missed: int = 0

    @property
    def miss_rate(self) -> float:
        """Probability that the person accepts a wrong mark."""
        return beta_mean(self.missed, self.shifted)


def beta_mean(events: int, trials: int) -> float:
    """Return the posterior mean of a rate under Jeffreys' prior."""
    return (events + 0.5) / (trials + 1.0)


def wrong_rate(rejected: int, judged: int, counts: Iterable[ShiftCount]) -> float:
    """Return the probability that the machine's mark is wrong, at most one half.

    People reject the share p (1 - m) of the marks. m is their common miss rate.
    """
    every = [*counts]
    m = beta_mean(sum(count.missed for count in every), sum(count.shifted for count in every))
    return min(0.5, beta_mean(rejected, judged) / (1.0 - m))


def widened_px(sigma_px: float, side_px: float, wrong: float, miss_rates: Iterable[float]) -> float:
    """Return the deviation (px per coordinate) of a mark that people of these miss rates confirmed."""
    missed = wrong * math.prod(miss_rates)
    return math.hypot(sigma_px, math.sqrt(missed / (missed + 1.0 - wrong)) * shift_px(side_px))
