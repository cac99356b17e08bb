"""A measured corner as a mixture over all edges beside the measured lines that may be the board's.

A rim, its shadow, a pattern or an edge of the background may run beside the board's edge, and one frame cannot tell
which of them is the board's. Two kinds of lines are told apart by all frames of a recording. Sharpening adds the same
profile beside the edge in every frame; it is no edge. A pattern's lines lie equally far inside (`pattern_lines`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from apexcal.documents.corners import CornerName
from apexcal.documents.crops import LEAST_SHIFT_PX
from workers.marks.edges import CornerFit, SecondPlace, inward
from workers.marks.pattern_lines import (
    HALF,
    REACH_PX,
    THICKEST_M,
    LinesBeside,
    PatternLine,
    is_repeated,
    lines_beside,
    pattern_line,
)
from workers.marks.profiles import SHARPEST_PX, SHORTEST_PX, STEP_PX, Crop, Curve, TracedEdge, slopes_of, trace_edge
from workers.marks.sights import Floats, Image

_OFFSETS: Final = STEP_PX * np.arange(-HALF, HALF + 1, dtype=np.float64)
_PARTS: Final = 6  # an edge is cut into so many parts; the median over them counts
_OWN_PX: Final = SHARPEST_PX  # a nearer line is the measured edge itself
_LEAST: Final = 0.2
"""Least strength of an edge, as a share of the profile's strongest one. The sharpening of `vlp16-diamond-board`
scatters by a tenth about its median."""
_MOST: Final = 6  # edges in a profile
_FEWEST: Final = 8  # edges from which the sharpening is learned
_OUTSIDE: Final = 2.0
"""Power that weakens lines outside of the measured ones. Of 129 such lines with less than half of the measured line's
strength, 16 were the board's edge (tips of seven rendered scenes: seeds 0, 1, 3, 5, 14, 15 and 9017)."""
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
    across: Floats = STEP_PX * np.arange(-HALF - pad, HALF + pad + 1.0, dtype=np.float64)
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
    turned = np.median(parts * np.sign(parts[:, HALF : HALF + 1]), axis=0)
    plain = np.median(parts, axis=0)
    plain *= np.sign(plain[HALF]) or 1.0
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
        (key, side): lines_beside(beside.changes[side], edges[key][side], shape, float(beside.px_per_m[side]))
        for key, beside in besides.items()
        for side in (0, 1)
    }
    patterns = {
        (name, side): pattern_line([sights[key, side] for key in besides if key[1] == name])
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
            rim_px = max(_OWN_PX, THICKEST_M * scale)
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


def _board_outside(pattern: PatternLine, lines: LinesBeside) -> _Side:
    """Return the edge whose measured line is the pattern's: where the board ends, or both if nothing shows that."""
    at_px = pattern.inside_m * lines.px_per_m
    if lines.ends_outside(at_px):
        return _Side(np.zeros(1), np.ones(1), 0.0, -at_px, pattern.scatter_px**2)
    return _Side(np.array([0.0, -at_px]), np.array([0.5, 0.5]), 0.0)


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
    return offset <= max(_OWN_PX, THICKEST_M * px_per_m) or not is_repeated(offset, others)


def _shape(changes: Sequence[Floats]) -> Floats:
    """Return (4 H + 1,) an edge's usual profile: the median outside of the measured edges, mirrored to the inside."""
    half = np.exp(-0.25 * (_OFFSETS[HALF:] / SHARPEST_PX) ** 2)
    strongest = [row / row[HALF] for row in changes if row[HALF] >= np.abs(row).max() > 0.0]
    if len(strongest) >= _FEWEST:
        half = np.median(np.array(strongest)[:, HALF::-1], axis=0)
    rest = np.zeros(HALF)
    return np.concatenate([rest, half[:0:-1], half, rest])


def _edges(changes: Floats, shape: Floats) -> tuple[Floats, Floats]:
    """Return offsets (K,) and strengths (K,) of a profile's edges, the measured one first (CLEAN: Hoegbom 1974)."""
    left, strengths = changes.copy(), np.zeros(len(changes))
    strengths[HALF] = max(float(changes[HALF]), 0.0)
    left -= strengths[HALF] * shape[HALF : HALF + len(changes)]
    least = _LEAST * float(np.abs(changes).max())
    for _ in range(_MOST):
        at = int(np.abs(left).argmax())
        strength = float(left[at])
        if abs(strength) <= least:
            break
        strengths[at] += abs(strength)
        left -= strength * shape[2 * HALF - at : 2 * HALF - at + len(changes)]
    near = np.abs(_OFFSETS) <= _OWN_PX
    own = float(strengths[near].sum())
    others = np.flatnonzero((strengths > 0.0) & ~near)
    return np.append(0.0, _OFFSETS[others]), np.append(own, strengths[others]) / max(own, strengths.max(), 1e-9)
