"""The corners of the board, and how they are named.

``top`` is the tip, the vertex of Algorithm 1. ``left`` and ``right`` are the ends of the two edges that fall from it,
to the left and to the right as the LiDAR sees the board (z up). ``bottom`` is the corner opposite to the tip.

On a board with level edges ``top`` is the upper corner that the detection's option ``upper_corner`` names. The other
names go with its edges: of the upper left corner ``left`` is the lower left one and ``right`` the upper right one, of
the upper right corner ``left`` is the upper left one and ``right`` the lower right one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import dist, hypot, radians
from typing import Final, Literal, TypeVar, get_args

Key = TypeVar("Key")
CornerName = Literal["top", "left", "right", "bottom"]
CORNERS: Final[tuple[CornerName, ...]] = get_args(CornerName)
TOP: Final[CornerName] = "top"

# Two detections mean the same corner of a sweep if their places are at most so far apart: in metres, or as an angle
# that the LiDAR sees, whichever is larger. The angle is for far boards, where rings are farther apart than 0.10 m.
_SAME_M: Final = 0.10
_SAME_RAD: Final = radians(0.3)


def how_far(place_a: Sequence[float], place_b: Sequence[float]) -> float | None:
    """Metres between two places of a corner in one sweep (LiDAR frame); None if they are two different ones."""
    away = dist(place_a, place_b)
    return away if away <= max(_SAME_M, _SAME_RAD * hypot(*place_b)) else None


def nearest(candidates: Iterable[tuple[Key, Sequence[float]]], corner: Sequence[float]) -> Key | None:
    """Whose place in the same sweep is the same corner; the nearest one, or None."""
    near = [(away, key) for key, position in candidates if (away := how_far(position, corner)) is not None]
    return min(near, key=lambda pair: pair[0])[1] if near else None
