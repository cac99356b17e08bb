"""Whether something moves as somebody walks, or jumps from place to place as the board of still poses does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

APART_S: Final = 1.5  # a track reaches no farther
_FASTEST_M_S: Final = 3.0
_BRISKEST_M_S2: Final = 3.0  # somebody who turns round: 1.4 m/s to and fro within a second
_TREMBLE_M: Final = 0.2
_STAYS_M: Final = 0.1


class Steps(NamedTuple):
    """How often one thing moves on as somebody walks, how often it jumps, and how far it gets between two jumps."""

    walks: int
    jumps: int
    way_m: float


def jumps(places: Sequence[tuple[int, float, float]]) -> bool:
    """Whether places of one thing (stamp in ns, x, y in metres) jump more often than they move as somebody walks."""
    steps = count_steps(places)
    return steps.jumps > steps.walks


def count_steps(places: Sequence[tuple[int, float, float]]) -> Steps:
    """The steps of one thing between places (stamp in ns, x, y in metres); where it stays counts as neither.

    Who walks goes on nearly as before; from pose to pose the next place has nothing to do with the one before.
    """
    walks = odd = 0
    start, way_m = next(iter(places), (0, 0.0, 0.0)), 0.0
    for before, at, after in zip(places, places[1:], places[2:], strict=False):
        step_s = max(at[0] - before[0], after[0] - at[0]) * 1e-9
        step_m = max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:]))
        bend_m = math.hypot(*(after[k] - 2.0 * at[k] + before[k] for k in (1, 2)))
        too_far = step_m > _TREMBLE_M + _FASTEST_M_S * step_s
        stays = step_m < _STAYS_M
        if not stays and (step_s > APART_S or too_far or bend_m > _TREMBLE_M + _BRISKEST_M_S2 * step_s**2):
            odd += 1
            start = after
            continue
        walks += not stays
        way_m = max(way_m, math.dist(start[1:], after[1:]))
    return Steps(walks, odd, way_m)
