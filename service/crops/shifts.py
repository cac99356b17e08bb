"""Choose which marks of a page are shifted, and how far. Pure functions: no database.

Whoever accepts all marks without a look accepts the shifted ones too, and is told so.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random
from typing import Final, NamedTuple
from uuid import UUID

from apexcal.documents.crops import CROPS_PER_PAGE, LEAST_SHIFT_PX, LEAST_SHIFTED, MOST_SHIFT_SHARE

_MORE_SHIFTED: Final = 4  # the number is uniform over these: after three a person still cannot stop looking
MOST_MISSED: Final = 2  # a page with two missed shifts is shown again
_TRIES: Final = 64  # of the lengths and both turns, where the frame's edge is near


def shift_px(side_px: float) -> float:
    """Return the root mean square of a shift's coordinate (px): E[s^2] / 2 of lengths alike likely in between."""
    least, most = LEAST_SHIFT_PX, MOST_SHIFT_SHARE * side_px
    return math.sqrt((most**3 - least**3) / (6.0 * (most - least)))


MarkLimits = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class ShownMark:
    """A mark of the machine as a crop may show it: its pixel and the crop's side.

    ``expected_u``, ``expected_v``: the pixel about which it is expected, which people may know.
    ``limits_px``: least and largest u, then v, at which its picture can show a mark.
    """

    vertex_id: UUID
    u: float
    v: float
    side_px: float
    expected_u: float
    expected_v: float
    limits_px: MarkLimits


class DrawnCrop(NamedTuple):
    """A mark and the pixel (u, v) at which it is drawn; ``shifted`` where that is not its own."""

    mark: ShownMark
    u: float
    v: float
    shifted: bool


def draw_page(unjudged: Sequence[ShownMark], confirmed: Sequence[ShownMark], random: Random) -> list[DrawnCrop]:
    """Return the crops of a page in random order, at least `LEAST_SHIFTED` of them shifted.

    ``unjudged`` marks need a look, and a shifted one needs another one later. If they do not fill a page,
    ``confirmed`` ones do. Each is shifted alike often: who knows which were confirmed knows nothing.
    """
    marks = random.sample(unjudged, min(len(unjudged), CROPS_PER_PAGE))
    marks += random.sample(confirmed, min(len(confirmed), CROPS_PER_PAGE - len(marks)))
    count = min(LEAST_SHIFTED + random.randrange(_MORE_SHIFTED), max(LEAST_SHIFTED, len(marks) // 2))
    random.shuffle(marks)
    drawn: list[DrawnCrop] = []
    for mark in marks:
        shifted = _shifted(mark, random) if sum(crop.shifted for crop in drawn) < count else None
        drawn.append(shifted or DrawnCrop(mark, mark.u, mark.v, shifted=False))
    random.shuffle(drawn)
    return drawn


def _shifted(mark: ShownMark, random: Random) -> DrawnCrop | None:
    """Turn the mark about the pixel where it is expected; None where all that is left is outside of the frame.

    A turn about a point, by any angle, of points in all directions of it gives points in all directions of it: where
    it is drawn says nothing of whether it was turned.
    """
    (left, right), (top, bottom) = mark.limits_px
    centre = complex(mark.expected_u, mark.expected_v)
    arm = complex(mark.u, mark.v) - centre
    for _ in range(_TRIES):
        length = random.uniform(LEAST_SHIFT_PX, MOST_SHIFT_SHARE * mark.side_px)
        angle = random.choice((-2.0, 2.0)) * math.asin(min(1.0, 0.5 * length / abs(arm)))
        drawn = centre + arm * cmath.rect(1.0, angle)
        if left <= drawn.real <= right and top <= drawn.imag <= bottom:
            return DrawnCrop(mark, drawn.real, drawn.imag, shifted=True)
    return None
