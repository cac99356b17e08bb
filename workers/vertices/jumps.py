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


# Stamp in nanoseconds, x and y in metres.
Place = tuple[int, float, float]


class Steps(NamedTuple):
    """How often one thing moves on as somebody walks, how often it jumps, and how far it gets between two jumps."""

    walks: int
    jumps: int
    way_m: float


def jumps(places: Sequence[Place]) -> bool:
    """Whether places of one thing jump more often than they move as somebody walks.

    Two places that no track joins tell neither. A place without which the others go on is another thing's.
    """
    runs = [[at for k, at in enumerate(run) if not _astray(run, k)] for run in _runs(places)]
    steps = [count_steps(run) for run in runs]
    return sum(part.jumps for part in steps) > sum(part.walks for part in steps)


def count_steps(places: Sequence[Place]) -> Steps:
    """The steps of one thing between places; where it stays counts as neither.

    Who walks goes on nearly as before; from pose to pose the next place has nothing to do with the one before.
    """
    walks = odd = 0
    start, way_m = next(iter(places), (0, 0.0, 0.0)), 0.0
    for before, at, after in zip(places, places[1:], places[2:], strict=False):
        if _odd(before, at, after):
            odd += 1
            start = after
            continue
        walks += not _stays(before, at, after)
        way_m = max(way_m, math.dist(start[1:], after[1:]))
    return Steps(walks, odd, way_m)


def _stays(before: Place, at: Place, after: Place) -> bool:
    return max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:])) < _STAYS_M


def _odd(before: Place, at: Place, after: Place) -> bool:
    """Whether nobody walks so."""
    step_s = max(at[0] - before[0], after[0] - at[0]) * 1e-9
    step_m = max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:]))
    bend_m = math.hypot(*(after[k] - 2.0 * at[k] + before[k] for k in (1, 2)))
    too_far = step_m > _TREMBLE_M + _FASTEST_M_S * step_s
    too_bent = bend_m > _TREMBLE_M + _BRISKEST_M_S2 * step_s**2
    return not _stays(before, at, after) and (step_s > APART_S or too_far or too_bent)


def _runs(places: Sequence[Place]) -> list[list[Place]]:
    """Stretches of places that a track joins."""
    runs: list[list[Place]] = []
    for at in places:
        if not runs or at[0] - runs[-1][-1][0] > APART_S * 1e9:
            runs.append([])
        runs[-1].append(at)
    return runs


def _astray(run: Sequence[Place], k: int) -> bool:
    others = [*run[max(k - 2, 0) : k], *run[k + 1 : k + 3]]
    if not 0 < k < len(run) - 1 or len(others) < 3 or not _odd(*run[k - 1 : k + 2]):
        return False
    return not any(_odd(*three) for three in zip(others, others[1:], others[2:], strict=False))
