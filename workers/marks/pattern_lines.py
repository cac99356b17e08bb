"""Lines of a board's pattern beside its edges, as all frames of a recording tell them.

A line that lies equally far inside of the measured edge in half of the frames, farther than a board is thick, belongs
to the pattern. A pattern is on the board in every frame. So where its line is missing inside, the measured line is
that line, as with a white margin before a white wall, and the board ends outside of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.marks.profiles import STEP_PX
from workers.marks.sights import Floats

REACH_PX: Final = 8.0
SEEN_PX: Final = 14.0  # a pattern's line within reach in a far frame lies farther off in near frames
HALF: Final = round(SEEN_PX / STEP_PX)
SAME_PX: Final = 1.0
SAME_SHARE: Final = 0.1  # of the distance: error of a frame's scale across an edge
_REPEATED: Final = 0.5  # share of the frames
_FEWEST_ALIKE: Final = 4  # frames; if lines of the background meet each of six by chance (0.3), one in 14 times
THICKEST_M: Final = 0.012
"""Boards of foam, composite and plywood are 3 to 12 mm thick, so their rim may lie this far inside."""
_GRID_M: Final = 0.0025
_SEEN_SHARE: Final = 2.0 / 3.0
"""Of the frames: a pattern's line is seen inside of the measured edge. On a public recording's chessboard it was in
0.70 and 0.74 of them, a rim that some frames hide in 0.42 and 0.50 (cells `rims` and `all three`, seed 500)."""
_STANDS_OUT: Final = 3.0
"""How much the image changes where the board ends, against elsewhere outside. It was at most 2.1 in six corners of
rendered scenes whose measured line was the board's though no pattern was seen inside (seeds 512 and 522)."""
_AS_STRONG: Final = 2.0
"""The measured line may be the pattern's if neither is stronger than the other by more than this: a line of half of
the strongest one's strength would not be missed (`alternatives._LEAST`).
"""


class LinesBeside(NamedTuple):
    """An edge's lines inside of the measured one, px and levels a pixel, and the measured one's strength.

    ``outside``: changes outside of the measured line, without its own flank, outward in steps of `STEP_PX`.
    ``px_per_m``: pixels across the edge for a metre.
    """

    inside_px: Floats
    strengths: Floats
    own: float
    outside: Floats
    px_per_m: float

    def near(self, at_px: float) -> NDArray[np.bool_]:
        """Return which lines lie so far inside."""
        return _is_same(self.inside_px, at_px)

    def ends_outside(self, at_px: float) -> bool:
        """Return whether the image changes so far outside more than elsewhere outside, and more than nearer by."""
        away = STEP_PX * np.arange(1, len(self.outside) + 1)
        there = self.outside[np.abs(away - at_px) <= SAME_PX]
        return bool(there.argmax() > 0 and there.max() > _STANDS_OUT * np.median(self.outside))


def lines_beside(changes: Floats, edges: tuple[Floats, Floats], shape: Floats, px_per_m: float) -> LinesBeside:
    """Return the lines beside a measured edge.

    Args:
        changes: (G,) levels a pixel across the edge, positive offsets inside the board.
        edges: offsets (K,) px and strengths (K,) of its lines, the measured one first.
        shape: (2 G - 1,) the usual profile of an edge.
    """
    offsets, weights = edges
    levels = float(np.abs(changes).max())
    own = levels * float(weights[0])
    is_inside = offsets > 0.0
    rest = np.abs(changes - own * shape[HALF : HALF + len(changes)])
    return LinesBeside(offsets[is_inside], levels * weights[is_inside], own, rest[HALF - 1 :: -1], px_per_m)


class PatternLine(NamedTuple):
    """The line of a board's pattern nearest to an edge: metres inside, its scatter px, and levels a pixel."""

    inside_m: float
    scatter_px: float
    strength: float

    def is_measured(self, lines: LinesBeside) -> bool:
        """Return whether this line may have been measured in a frame: it is as strong, and nothing such lies inside.

        Where a rim or its shadow was measured, the pattern lies a little nearer or farther inside.
        """
        if not lines.px_per_m > 0.0:
            return False
        at_px, least = self.inside_m * lines.px_per_m, self.strength / _AS_STRONG
        is_told = SAME_PX + SAME_SHARE * at_px < at_px < REACH_PX and not lines.near(at_px).any()
        is_about = np.abs(np.log2(lines.inside_px / at_px)) < 1.0
        about = float(lines.strengths[is_about].sum())
        return is_told and about < least < lines.own < self.strength * _AS_STRONG


def pattern_line(frames: Sequence[LinesBeside]) -> PatternLine | None:
    """Return the line that lies equally far inside in most of the frames that reach so far, if there is one."""
    frames = [frame for frame in frames if frame.px_per_m > 0.0]
    lines_m = np.concatenate([np.zeros(0), *(frame.inside_px / frame.px_per_m for frame in frames)])
    best: list[tuple[float, float, float]] = []
    for at_m in (_GRID_M * np.unique(np.rint(lines_m[lines_m > THICKEST_M] / _GRID_M))).tolist():
        reached = [frame for frame in frames if at_m * frame.px_per_m < SEEN_PX - SAME_PX]
        same: list[tuple[float, float, float]] = []
        for frame in reached:
            near = frame.near(at_m * frame.px_per_m)
            if near.any():
                strongest = int(np.argmax(np.where(near, frame.strengths, 0.0)))
                px, scale = float(frame.inside_px[strongest]), frame.px_per_m
                same.append((px / scale, px - at_m * scale, float(frame.strengths[strongest])))
        if len(same) >= max(_FEWEST_ALIKE, _SEEN_SHARE * len(reached)) and len(same) > len(best):
            best = same
    if not best:
        return None
    inside_m, off_px, strength = np.array(best).T
    scatter_px = 1.4826 * float(np.median(np.abs(off_px - np.median(off_px))))
    if scatter_px > SAME_PX:
        return None
    return PatternLine(float(np.median(inside_m)), max(scatter_px, STEP_PX), float(np.median(strength)))


def is_repeated(offset: float, others: Sequence[tuple[Floats, float]]) -> bool:
    """Return whether an edge lies as many metres inside in half of the frames that reach so far.

    ``others``: offsets and scale of the other frames, each scale over this frame's.
    """
    reached = [(offsets, offset * scale) for offsets, scale in others if offset * scale < SEEN_PX - SAME_PX]
    same = sum(bool(_is_same(offsets, at_px).any()) for offsets, at_px in reached)
    return same >= max(_FEWEST_ALIKE, _REPEATED * len(reached))


def _is_same(offsets: Floats, at_px: float) -> NDArray[np.bool_]:
    """Return which offsets (K,) px are this one, as far as a frame's scale across an edge is known."""
    return np.abs(offsets - at_px) <= SAME_PX + SAME_SHARE * at_px
