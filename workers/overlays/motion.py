"""Points of the board and its holder, moved to a frame's time along the corner's track. The vehicle stands.

The pages do the same (``frontend/src/lib/overlay/motion.ts``); shared vectors hold both to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Between vertices farther apart a walker may have turned round.
LONGEST_NS: Final = 1_500_000_000
# A board of 60 x 90 cm reaches so far from the line below its corner, and so far down.
_BESIDE_M: Final = 0.55
_BELOW_M: Final = 1.1
_ABOVE_M: Final = 0.1


class Moment(NamedTuple):
    """Where the corner was: metres, LiDAR frame."""

    time_ns: int
    x: float
    y: float
    z: float


class Motion(NamedTuple):
    """The board's corner at a moment, metres and metres a second."""

    at_ns: int
    corner: Floats
    velocity: Floats


class Moved(NamedTuple):
    """Points (N, 3) float32, how many of them were moved, and the farthest of these."""

    points: NDArray[np.float32]
    number: int
    farthest_m: float


def motion_at(vertices: Sequence[Moment], at_ns: int) -> Motion | None:
    """How the corner moves at a moment, by the vertices before and after it; None where the track is open."""
    before = max((one for one in vertices if one.time_ns <= at_ns), key=lambda one: one.time_ns, default=None)
    after = min((one for one in vertices if one.time_ns > at_ns), key=lambda one: one.time_ns, default=None)
    if before is None or after is None or after.time_ns - before.time_ns > LONGEST_NS:
        return None
    start = np.array(before[1:], np.float64)
    velocity = (np.array(after[1:], np.float64) - start) / ((after.time_ns - before.time_ns) / 1e9)
    return Motion(at_ns, start + (at_ns - before.time_ns) / 1e9 * velocity, velocity)


def moved(points: NDArray[np.float32], times_ns: NDArray[np.int64], motion: Motion) -> Moved:
    """The points with those of board and holder where they were at the motion's moment.

    Args:
        points: (N, 3), metres, LiDAR frame.
        times_ns: (N,), when each was measured.
    """
    later = (motion.at_ns - times_ns) / 1e9
    there = points.astype(np.float64) + later[:, None] * motion.velocity
    above = there[:, 2] - motion.corner[2]
    beside = np.hypot(*(there[:, :2] - motion.corner[:2]).T)
    walker = (above <= _ABOVE_M) & (above >= -_BELOW_M) & (beside <= _BESIDE_M)
    farthest = float(np.abs(later[walker]).max(initial=0.0) * np.linalg.norm(motion.velocity))
    # Points are float32 as the sensors' and the pages' are.
    return Moved(np.where(walker[:, None], there.astype(np.float32), points), int(walker.sum()), farthest)
