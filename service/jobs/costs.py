"""What solver work costs, predicted before it is done.

Seconds of one processor, for cutting work into jobs and for refusing what would never end. The search counts with
all the iterations that its schedule allows; most end after a third of them.
"""

from __future__ import annotations

from typing import NamedTuple

# Nanoseconds for each individual of the search, and for each of its pairs. Measured on a 2-core x86-64 machine with
# AVX2, one thread, the dearer loss, 16 to 100,000 pairs: 71-82 and 0.22-0.35; 142-168 and 0.51-0.76; 206-244 and
# 0.60-0.98. What a pair costs grows with their number, as they leave the caches: the upper ends are taken.
INDIVIDUAL_NS = {"pinhole": 82.0, "brown_conrady": 168.0, "kannala_brandt": 244.0}
PAIR_NS = {"pinhole": 0.35, "brown_conrady": 0.76, "kannala_brandt": 0.98}
# Around the kernel: what it is given (0.07 ms measured) and the row that keeps its best.
SLOT_MS = 0.2
# The end of a run: polish, outliers, baselines, uncertainty. Measured with 1500 pairs that state covariances:
# 395-521, 607-783 and 542-605 microseconds a pair; with equal weights it is half.
FINISH_MS = 100.0
FINISH_PAIR_US = {"pinhole": 520.0, "brown_conrady": 780.0, "kannala_brandt": 600.0}
# And a sentence about each outlier, which looks at all pairs: 17 ns measured; half of the pairs may be outliers.
OUTLIER_PAIR_NS = 8.5
# Two cameras' marks of the same vertices held against each other: 1.7-2.3 microseconds measured, keys besides.
SHARED_PAIR_US = 10.0


class RunCost(NamedTuple):
    """One fit: seconds of a slot and of the end, and the most slots that all its iterations run."""

    slot_s: float
    slots: int
    finish_s: float

    @property
    def seconds(self) -> float:
        """The whole run."""
        return self.slots * self.slot_s + self.finish_s

    @property
    def longest_s(self) -> float:
        """The longest work that cannot be cut."""
        return max(self.slot_s, self.finish_s)


def run_cost(model: str, pairs: int, slots: int, population: int, generations: int, max_iterations: int) -> RunCost:
    """What fitting a model to so many pairs costs, under a schedule."""
    individual_ns = INDIVIDUAL_NS[model] + PAIR_NS[model] * pairs
    slot_s = 1e-3 * SLOT_MS + 1e-9 * population * generations * individual_ns
    finish_s = 1e-3 * FINISH_MS + 1e-6 * FINISH_PAIR_US[model] * pairs + 1e-9 * OUTLIER_PAIR_NS * pairs**2
    return RunCost(slot_s, slots * max_iterations, finish_s)


def comparison_s(cameras: int, pairs: int) -> float:
    """Seconds of holding every two cameras against each other, each with at most so many pairs."""
    return 1e-6 * SHARED_PAIR_US * pairs * cameras * (cameras - 1) / 2
