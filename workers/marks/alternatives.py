"""A measured corner as a mixture over all edges beside the measured lines that may be the board's.

A rim, its shadow, a pattern or an edge of the background may run beside the board's edge, and one frame cannot tell
which of them is the board's. Two kinds of lines are told apart by all frames of a recording. Sharpening adds the same
profile beside the edge in every frame; it is no edge. A line that lies equally far inside in half of the frames,
farther than a board is thick, belongs to the pattern. A pattern is seen in all frames: where its line is missing
inside, the measured line is that line, as with a white margin before a white wall, and the board ends outside of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CornerName
from apexcal.documents.crops import LEAST_SHIFT_PX
from workers.marks.edges import CornerFit, SecondPlace, inward
from workers.marks.profiles import SHARPEST_PX, SHORTEST_PX, STEP_PX, Crop, Curve, TracedEdge, slopes_of, trace_edge
from workers.marks.sights import Floats, Image

REACH_PX: Final = 8.0
_SEEN_PX: Final = 14.0  # a pattern's line within reach in a far frame lies farther off in near frames
_HALF: Final = round(_SEEN_PX / STEP_PX)
_OFFSETS: Final = STEP_PX * np.arange(-_HALF, _HALF + 1, dtype=np.float64)
_PARTS: Final = 6  # an edge is cut into so many parts; the median over them counts
_OWN_PX: Final = SHARPEST_PX  # a nearer line is the measured edge itself
_LEAST: Final = 0.2
"""Least strength of an edge, as a share of the profile's strongest one. The sharpening of `vlp16-diamond-board`
scatters by a tenth about its median."""
_MOST: Final = 6  # edges in a profile
_FEWEST: Final = 8  # edges from which the sharpening is learned
_SAME_PX: Final = 1.0
_SAME_SHARE: Final = 0.1  # of the distance: error of a frame's scale across an edge
_OUTSIDE: Final = 2.0
"""Power that weakens lines outside of the measured ones. Of 129 such lines with less than half of the measured line's
strength, 16 were the board's edge (tips of seven rendered scenes: seeds 0, 1, 3, 5, 14, 15 and 9017)."""
_REPEATED: Final = 0.5  # share of the frames
_FEWEST_ALIKE: Final = 4  # frames; if lines of the background meet each of six by chance (0.3), one in 14 times
_THICKEST_M: Final = 0.012
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
the strongest one's strength would not be missed (`_LEAST`).
"""
_SECOND: Final = 0.25
"""A corner stays open if a second place, more than `LEAST_SHIFT_PX` away, has at least this share. Four of 75 corners
of `vlp16-diamond-board` have one; in all four the measured place is 4 to 8 px off, and the second within 2 px."""


class Beside(NamedTuple):
    """The grey levels' changes across both edges of a corner.

    Attributes:
        changes: (2, G) levels a pixel at `_OFFSETS`, whose positive values lie inside the board.
        inward: (2,) numbers with the signs of the directions into the board.
        px_per_m: (2,) pixels across the edge for a metre.
    """

    changes: Floats
    inward: Floats
    px_per_m: Floats


def look_beside(image: Image, edges: tuple[Curve, Curve], fit: CornerFit, px_per_m: Floats) -> Beside:
    """Measure the changes beside the measured lines of a corner; zero beyond the image."""
    pad = np.ceil(3.0 * SHARPEST_PX / STEP_PX)
    across: Floats = STEP_PX * np.arange(-_HALF - pad, _HALF + pad + 1.0, dtype=np.float64)
    changes = np.zeros((2, len(_OFFSETS)))
    signs = np.array(inward(edges))
    for row, (curve, line, within) in enumerate(zip(edges, fit.lines, signs, strict=True)):
        traced = trace_edge(curve, image.shape[1], image.shape[0])
        if not isinstance(traced, TracedEdge):
            continue
        moved = traced.moved(*line)
        places = moved.pixels[:, None] + np.sign(within) * across[None, :, None] * moved.normals[:, None]
        profiles = Crop.around(image, places.reshape(-1, 2)).sampled(places)
        profiles = profiles[np.isfinite(profiles).all(axis=1)]
        if len(profiles) >= SHORTEST_PX:
            slope = slopes_of(profiles, SHARPEST_PX)[0][:, int(pad) : -int(pad)]
            changes[row] = _common(np.array([part.mean(axis=0) for part in np.array_split(slope, _PARTS)]))
    return Beside(changes, signs, px_per_m)


def _common(parts: Floats) -> Floats:
    """Return the profile (G,) that the parts (P, G) of an edge share, positive at the measured line.

    The background behind a board may be darker at some parts and brighter at others, so their signs may differ.
    """
    turned = np.median(parts * np.sign(parts[:, _HALF : _HALF + 1]), axis=0)
    plain = np.median(parts, axis=0)
    plain *= np.sign(plain[_HALF]) or 1.0
    return np.where(np.abs(plain) > np.abs(turned), plain, turned)


def mixed(
    fits: Mapping[tuple[int, CornerName], CornerFit], besides: Mapping[tuple[int, CornerName], Beside]
) -> dict[tuple[int, CornerName], CornerFit]:
    """Return the corners of a recording as mixtures.

    The measured lines are the outermost ones along most of both edges, so a weaker line outside of them is hardly the
    board's edge. Lines within a board's thickness are its rim, and the corner is the mean over them. Lines farther
    inside count in the covariance alone. If two places are likely and far apart, the corner has both.
    """
    shape = _shape([changes for beside in besides.values() for changes in beside.changes])
    edges = {key: [_edges(changes, shape) for changes in beside.changes] for key, beside in besides.items()}
    sights = {
        (key, side): _lines_beside(beside, edges[key][side], shape, side)
        for key, beside in besides.items()
        for side in (0, 1)
    }
    patterns = {
        (name, side): _pattern_line([sights[key, side] for key in besides if key[1] == name])
        for name in {name for _, name in besides}
        for side in (0, 1)
    }
    mixtures: dict[tuple[int, CornerName], CornerFit] = {}
    for key, fit in fits.items():
        alike = [other for other in besides if other[1] == key[1]]
        sides: list[_Side] = []
        for side, (offsets, weights) in enumerate(edges[key]):
            scale = float(besides[key].px_per_m[side])
            pattern = patterns[key[1], side]
            if pattern is not None and pattern.is_measured(sights[key, side]):
                sides.append(_board_outside(pattern, sights[key, side]))
                continue
            others = [(edges[other][side][0], besides[other].px_per_m[side] / scale) for other in alike]
            is_board = np.array([_may_be_board(offset, scale, others) for offset in offsets.tolist()], np.bool_)
            rim_px = max(_OWN_PX, _THICKEST_M * scale)
            odds = np.where(offsets < -rim_px, weights**_OUTSIDE, weights) * is_board
            sides.append(_Side(offsets, odds / max(float(odds.sum()), 1e-9), rim_px))
        mixtures[key] = _mixture(fit, np.sign(besides[key].inward), sides)
    return mixtures


class _Side(NamedTuple):
    """An edge's offsets (K,) px and their shares (K,), and a rim's largest offset, px.

    ``shift_px``, ``variance``: where the board ends against the measured line, if that is the pattern's.
    """

    offsets: Floats
    share: Floats
    rim_px: float
    shift_px: float = 0.0
    variance: float = 0.0


class _LinesBeside(NamedTuple):
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
        """Return which lines lie so far inside, as far as a frame's scale is known."""
        return np.abs(self.inside_px - at_px) <= _SAME_PX + _SAME_SHARE * at_px

    def ends_outside(self, at_px: float) -> bool:
        """Return whether the image changes so far outside more than elsewhere outside, and more than nearer by."""
        away = STEP_PX * np.arange(1, len(self.outside) + 1)
        there = self.outside[np.abs(away - at_px) <= _SAME_PX]
        return bool(there.argmax() > 0 and there.max() > _STANDS_OUT * np.median(self.outside))


def _lines_beside(beside: Beside, edges: tuple[Floats, Floats], shape: Floats, side: int) -> _LinesBeside:
    offsets, weights = edges
    changes = beside.changes[side]
    levels = float(np.abs(changes).max())
    own = levels * float(weights[0])
    is_inside = offsets > 0.0
    rest = np.abs(changes - own * shape[_HALF : _HALF + len(changes)])
    outside = rest[_HALF - 1 :: -1]
    return _LinesBeside(offsets[is_inside], levels * weights[is_inside], own, outside, float(beside.px_per_m[side]))


class _PatternLine(NamedTuple):
    """The line of a board's pattern nearest to an edge: metres inside, its scatter px, and levels a pixel."""

    inside_m: float
    scatter_px: float
    strength: float

    def is_measured(self, lines: _LinesBeside) -> bool:
        """Return whether this line may have been measured in a frame: it is as strong, and nothing such lies inside.

        Where a rim or its shadow was measured, the pattern lies a little nearer or farther inside.
        """
        at_px, least = self.inside_m * lines.px_per_m, self.strength / _AS_STRONG
        is_told = _SAME_PX + _SAME_SHARE * at_px < at_px < REACH_PX and not lines.near(at_px).any()
        is_about = np.abs(np.log2(lines.inside_px / at_px)) < 1.0
        about = float(lines.strengths[is_about].sum())
        return is_told and about < least < lines.own < self.strength * _AS_STRONG


def _board_outside(pattern: _PatternLine, lines: _LinesBeside) -> _Side:
    """Return the edge whose measured line is the pattern's: where the board ends, or both if nothing shows that."""
    at_px = pattern.inside_m * lines.px_per_m
    if lines.ends_outside(at_px):
        return _Side(np.zeros(1), np.ones(1), 0.0, -at_px, pattern.scatter_px**2)
    return _Side(np.array([0.0, -at_px]), np.array([0.5, 0.5]), 0.0)


def _pattern_line(frames: Sequence[_LinesBeside]) -> _PatternLine | None:
    """Return the line that lies equally far inside in most of the frames that reach so far, if there is one."""
    lines_m = np.concatenate([np.zeros(0), *(frame.inside_px / frame.px_per_m for frame in frames)])
    best: list[tuple[float, float, float]] = []
    for at_m in (_GRID_M * np.unique(np.rint(lines_m[lines_m > _THICKEST_M] / _GRID_M))).tolist():
        reached = [frame for frame in frames if at_m * frame.px_per_m < _SEEN_PX - _SAME_PX]
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
    if scatter_px > _SAME_PX:
        return None
    return _PatternLine(float(np.median(inside_m)), max(scatter_px, STEP_PX), float(np.median(strength)))


def _mixture(fit: CornerFit, inward: Floats, sides: Sequence[_Side]) -> CornerFit:
    """Return a corner as a mixture over the lines of both edges."""
    means, variances = np.zeros(2), np.zeros(2)
    places: list[SecondPlace] = []
    across = np.linalg.inv(fit.normals) * inward
    for side, (offsets, share, rim_px, shift_px, variance) in enumerate(sides):
        is_rim = (offsets > 0.0) & (offsets <= rim_px)
        means[side] = shift_px + share[is_rim] @ offsets[is_rim]
        variances[side] = variance + share @ (offsets - (means[side] - shift_px)) ** 2
        away = offsets[:, None] * across[:, side]
        is_far = (np.hypot(*away.T) > LEAST_SHIFT_PX) & (share >= _SECOND)
        places += [SecondPlace(fit.pixel + away[at], float(share[at])) for at in np.flatnonzero(is_far)]
    shifted = fit.shifted(inward * means, variances)
    if not places:
        return shifted
    return shifted._replace(pixel=fit.pixel, second=max(places, key=lambda spot: spot.weight))


def _may_be_board(offset: float, px_per_m: float, others: Sequence[tuple[Floats, float]]) -> bool:
    if abs(offset) > REACH_PX:
        return False
    return offset <= max(_OWN_PX, _THICKEST_M * px_per_m) or not _is_repeated(offset, others)


def _shape(changes: Sequence[Floats]) -> Floats:
    """Return (4 H + 1,) an edge's usual profile: the median outside of the measured edges, mirrored to the inside."""
    half = np.exp(-0.25 * (_OFFSETS[_HALF:] / SHARPEST_PX) ** 2)
    strongest = [row / row[_HALF] for row in changes if row[_HALF] >= np.abs(row).max() > 0.0]
    if len(strongest) >= _FEWEST:
        half = np.median(np.array(strongest)[:, _HALF::-1], axis=0)
    rest = np.zeros(_HALF)
    return np.concatenate([rest, half[:0:-1], half, rest])


def _edges(changes: Floats, shape: Floats) -> tuple[Floats, Floats]:
    """Return offsets (K,) and strengths (K,) of a profile's edges, the measured one first (CLEAN: Hoegbom 1974)."""
    left, strengths = changes.copy(), np.zeros(len(changes))
    strengths[_HALF] = max(float(changes[_HALF]), 0.0)
    left -= strengths[_HALF] * shape[_HALF : _HALF + len(changes)]
    least = _LEAST * float(np.abs(changes).max())
    for _ in range(_MOST):
        at = int(np.abs(left).argmax())
        strength = float(left[at])
        if abs(strength) <= least:
            break
        strengths[at] += abs(strength)
        left -= strength * shape[2 * _HALF - at : 2 * _HALF - at + len(changes)]
    near = np.abs(_OFFSETS) <= _OWN_PX
    own = float(strengths[near].sum())
    others = np.flatnonzero((strengths > 0.0) & ~near)
    return np.append(0.0, _OFFSETS[others]), np.append(own, strengths[others]) / max(own, strengths.max(), 1e-9)


def _is_repeated(offset: float, others: Sequence[tuple[Floats, float]]) -> bool:
    """Return whether an edge lies as many metres inside in half of the frames that reach so far.

    ``others``: offsets and scale of the other frames, each scale over this frame's.
    """
    reached = [(offsets, offset * scale) for offsets, scale in others if offset * scale < _SEEN_PX - _SAME_PX]
    same = sum(bool(np.any(np.abs(offsets - at) <= _SAME_PX + _SAME_SHARE * at)) for offsets, at in reached)
    return same >= max(_FEWEST_ALIKE, _REPEATED * len(reached))
