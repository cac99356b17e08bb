"""What solver work costs, predicted before it is done.

Seconds of one processor, for cutting work into jobs and for refusing what would never end. The search counts with
all the iterations that its schedule allows; most end after a third of them.
"""

from __future__ import annotations

from typing import NamedTuple

from apexcal.documents.camera_models import CAMERA_MODELS, ModelName
from apexcal.documents.schedules import Schedule

# Cost around the kernel: preparing its input (0.07 ms measured) and storing its best.
SLOT_MS = 0.2
# The end of a run: polish, outliers, baselines, uncertainty; and what the model takes of each pair.
FINISH_MS = 100.0
# And a sentence about each outlier, which looks at all pairs: 17 ns measured; half of the pairs may be outliers.
OUTLIER_PAIR_NS = 8.5
# Comparing two cameras' marks of the same vertex: 1.7-2.3 microseconds measured, without the keys.
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


def run_cost(model: ModelName, pairs: int, schedule: Schedule) -> RunCost:
    """What fitting a model to so many pairs costs, under a schedule."""
    cost = CAMERA_MODELS[model].cost
    individual_ns = cost.individual_ns + cost.pair_ns * pairs
    slot_s = 1e-3 * SLOT_MS + 1e-9 * schedule.population * schedule.generations * individual_ns
    finish_s = 1e-3 * FINISH_MS + 1e-6 * cost.finish_pair_us * pairs + 1e-9 * OUTLIER_PAIR_NS * pairs**2
    return RunCost(slot_s, schedule.slots * schedule.max_iterations, finish_s)


def comparison_s(cameras: int, pairs: int) -> float:
    """Seconds of holding every two cameras against each other, each with at most so many pairs."""
    return 1e-6 * SHARED_PAIR_US * pairs * cameras * (cameras - 1) / 2
