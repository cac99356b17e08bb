"""The corners of the board, and how they are named.

``top`` is the tip, the vertex of Algorithm 1. ``left`` and ``right`` are the ends of the two edges that fall from it,
to the left and to the right as the LiDAR sees the board (z up). ``bottom`` is the corner opposite to the tip.
"""

from __future__ import annotations

from typing import Final, Literal, get_args

CornerName = Literal["top", "left", "right", "bottom"]
CORNERS: Final[tuple[CornerName, ...]] = get_args(CornerName)
TOP: Final[CornerName] = "top"
