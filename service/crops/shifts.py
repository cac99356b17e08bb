"""Which marks of a page are shifted, and how far. Pure functions: no database.

Whoever accepts all marks without a look accepts the shifted ones too, and is told so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple
from uuid import UUID

from apexcal.documents.crops import CROPS_PER_PAGE, LEAST_SHIFTED, SHIFT_SHARES

_MORE_SHIFTED: Final = 4  # so many numbers are alike likely: whoever has seen three cannot stop looking
MOST_MISSED: Final = 2  # a page on which so many were missed is asked again
_LEAST_SHARE, _MOST_SHARE = SHIFT_SHARES
MISSED_SHARE: Final = math.sqrt((_MOST_SHARE**3 - _LEAST_SHARE**3) / (6.0 * (_MOST_SHARE - _LEAST_SHARE)))
"""Root mean square of a shift's coordinate over the crop's side: E[s^2] / 2 of lengths alike likely in between."""
_TRIES: Final = 64  # an eighth of the shifts stays within the room even from its corner


Room = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class ShownMark:
    """A mark of the machine as a crop may show it: its pixel and the crop's side.

    ``room``: least and largest u, then v, at which its picture can show a mark. The true one too lies anywhere in it.
    """

    vertex_id: UUID
    u: float
    v: float
    side_px: float
    room: Room


class DrawnCrop(NamedTuple):
    """A mark and the pixel (u, v) at which it is drawn; ``shifted`` where that is not its own."""

    mark: ShownMark
    u: float
    v: float
    shifted: bool


def draw_page(unjudged: Sequence[ShownMark], confirmed: Sequence[ShownMark], random: Random) -> list[DrawnCrop]:
    """Return the crops of a page in random order, at least `LEAST_SHIFTED` of them shifted.

    ``unjudged`` marks need a look, and a shifted one needs another one later. If they do not fill a page,
    ``confirmed`` ones do, and these are shifted first, so that the last page is the last.
    """
    chosen = random.sample(unjudged, min(len(unjudged), CROPS_PER_PAGE))
    fillers = random.sample(confirmed, min(len(confirmed), CROPS_PER_PAGE - len(chosen)))
    count = min(
        LEAST_SHIFTED + random.randrange(_MORE_SHIFTED), max(LEAST_SHIFTED, (len(chosen) + len(fillers)) // 2)
    )
    controls = [*fillers, *chosen][:count]
    drawn = [_shifted(mark, random) for mark in controls]
    drawn += [DrawnCrop(mark, mark.u, mark.v, shifted=False) for mark in [*fillers, *chosen][count:]]
    random.shuffle(drawn)
    return drawn


def _shifted(mark: ShownMark, random: Random) -> DrawnCrop:
    (left, right), (top, bottom) = mark.room
    u, v = mark.u, mark.v
    for _ in range(_TRIES):
        angle, length = random.uniform(0.0, math.tau), mark.side_px * random.uniform(*SHIFT_SHARES)
        u, v = mark.u + length * math.cos(angle), mark.v + length * math.sin(angle)
        if left <= u <= right and top <= v <= bottom:
            break
    return DrawnCrop(mark, u, v, shifted=True)
