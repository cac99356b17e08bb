"""Measure where two straight edges of the board meet in a frame: profiles across both, a robust line through each.

A line is fitted to the offsets of the profiles' edges from the projected edge, so that a lens may bend both alike.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import cv2
import numpy as np

from workers.marks.profiles import (
    SHARPEST_PX,
    SHORTEST_PX,
    SOFTEST_PX,
    STEP_PX,
    WIDEST_PX,
    Crop,
    Curve,
    ProfileEdges,
    TracedEdge,
    find_edges,
    trace_edge,
)
from workers.marks.sights import Floats, Image

HALF_WIDTHS_PX: Final = (WIDEST_PX, 8.0, 4.0, 3.0)
AGREEING: Final = 0.35
_BOTH_AGREEING: Final = 1.0  # of both edges together: mere texture reaches 0.8 (development scenes)
FARTHEST_PX: Final = 30.0
_TOLERANCE_PX: Final = (1.5, 1.0, 0.5, 0.4)
_SOFT_SHARE: Final = 0.4
_ROUNDS: Final = 5
_HALVED_PX: Final = 4.0  # up to here the direction is known well
_SLOPES: Final = 17
_NEARNESS: Final = 0.3  # of a vote, lost at the window's rim
_OUTER_SHARE: Final = 0.7
_AVERAGE: Final = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0  # of five profiles
_AVERAGED: Final = float(np.linalg.norm(_AVERAGE))


class SecondPlace(NamedTuple):
    """Another place (2,) px where a corner may be, and its probability."""

    pixel: Floats
    weight: float


class CornerFit(NamedTuple):
    """The corner (2,) px, its covariance (2, 2) by the profiles' scatter, and how soft the edges are, px.

    `lines` (2, 2): offset and slope of both edges against their projections; `normals` (2, 2): of both lines.
    `extrapolation` (2, 2): what an error of both edges of variance 1 adds to the corner's, because it lies farther
    out than the edges are seen. `ambiguity` (2, 2): what other edges add that may be the board's. `second`: the other
    place of a corner that has two.
    """

    pixel: Floats
    covariance: Floats
    softness_px: float
    lines: Floats
    extrapolation: Floats
    normals: Floats
    ambiguity: Floats
    second: SecondPlace | None = None

    def shifted(self, offsets: Floats, variances: Floats) -> CornerFit:
        """The corner after its lines' shifts (2,) px along the normals, known to variances (2,)."""
        inverse = np.linalg.inv(self.normals)
        return self._replace(
            pixel=self.pixel + inverse @ offsets,
            ambiguity=inverse @ np.diag(variances) @ inverse.T,
        )


EdgeRefusal = Literal["outside", "few_pixels", "no_edge", "moved_far"]


class _Line(NamedTuple):
    """offset + slope * along, covariance (2, 2), share of agreeing profiles, softness."""

    offset: float
    slope: float
    covariance: Floats
    agreeing: float
    softness: float


def measure_corner(
    image: Image, edges: tuple[Curve, Curve], first_half_width: float = HALF_WIDTHS_PX[0], softness: float = 1.0
) -> CornerFit | EdgeRefusal:
    """The corner where two edges meet, measured from their projections on; or why not.

    Args:
        edges: the projections of both edges from the corner on.
        first_half_width: one of `HALF_WIDTHS_PX`: those above are skipped.
        softness: standard deviation of the frame's blur, px, as far as it is known.
    """
    pair: list[TracedEdge] = []
    for curve in edges:
        edge = trace_edge(curve, image.shape[1], image.shape[0])
        if not isinstance(edge, TracedEdge):
            return edge
        pair.append(edge)
    inside = inward(edges)
    crop = Crop.around(image, np.concatenate([edge.pixels for edge in pair]))
    start = np.asarray(edges[0](np.zeros(1)), np.float64)[0]
    lines: list[_Line] = []
    total = np.zeros((2, 2))
    for half_width, tolerance in zip(HALF_WIDTHS_PX, _TOLERANCE_PX, strict=True):
        if half_width > first_half_width:
            continue
        fitted = [
            _fit(crop, edge.moved(*shift), half_width, tolerance, softness, within)
            for edge, shift, within in zip(pair, total, inside, strict=True)
        ]
        lines = [line for line in fitted if line is not None]
        if len(lines) < 2 or min(line.agreeing for line in lines) < AGREEING:
            return "no_edge"
        total += [(line.offset, line.slope) for line in lines]
        softness = float(np.clip(np.mean([line.softness for line in lines]), SHARPEST_PX, SOFTEST_PX))
        corner = _intersection(edges, total)
        if corner is None:
            return "no_edge"
        if np.hypot(*(corner - start)) > FARTHEST_PX:
            return "moved_far"
    if sum(line.agreeing for line in lines) < _BOTH_AGREEING:
        return "no_edge"
    # Evenly seen over a length L, a line is known to (1 + 12 x^2 / L^2) / N at x from the middle, to 4 / N at its end
    # (Seber and Lee 2003, ch. 6): this is how much more, at the corner, what shifts an edge counts if it may turn it.
    growth = [3.0 * edge.hidden_share * (1.0 + edge.hidden_share) for edge in pair]
    return _with_covariance(edges, total, lines, float(np.mean([line.softness for line in lines])), growth)


def _fit(
    crop: Crop, edge: TracedEdge, half_width: float, tolerance: float, softness: float, inside: float
) -> _Line | None:
    """The outermost line that most profiles agree on; the sign of `inside` is that of offsets into the board."""
    wide = max(half_width, 2.5 * softness)
    sigma = float(np.clip(softness, SHARPEST_PX, SOFTEST_PX))
    pad = np.ceil(3.0 * sigma / STEP_PX) * STEP_PX
    across = np.arange(-wide - pad, wide + pad + 0.5 * STEP_PX, STEP_PX)
    profiles = crop.sampled(edge.pixels[:, None] + across[None, :, None] * edge.normals[:, None])
    usable = int(np.isfinite(profiles).all(axis=1).sum())
    if usable < SHORTEST_PX:
        return None
    # Neighbouring profiles are averaged: their noise and the texture behind the board do not repeat along an edge.
    averaged = cv2.sepFilter2D(profiles, -1, np.ones(1), _AVERAGE, borderType=cv2.BORDER_REPLICATE)
    profile_edges = find_edges(np.asarray(averaged, np.float64), across, wide, sigma, _AVERAGED * crop.noise)
    tolerance = max(tolerance, _SOFT_SHARE * softness)
    start = _voted(profile_edges, edge.along, wide, tolerance, inside)
    return _refined(profile_edges, edge.along, start, tolerance, usable, sigma)


def _voted(
    profile_edges: ProfileEdges, along: Floats, wide: float, tolerance: float, inside: float
) -> tuple[float, float]:
    """Offset and slope of a line that many profiles have an edge on, a Hough transform over both.

    A pattern has lines of its own, which may be the stronger ones: of lines with nearly as many profiles as the best
    the outermost is taken.
    """
    offsets, share = profile_edges.offsets, profile_edges.share
    reach = float(along[-1] - along[0])
    middle = 0.5 * float(along[-1] + along[0])
    bin_px = 0.5 * tolerance
    steepest = (wide if wide > _HALVED_PX else 0.5 * wide) / max(0.5 * reach, 1.0)
    slopes = np.linspace(-steepest, steepest, _SLOPES)
    there = np.isfinite(offsets)
    offset_at_middle = np.where(there, offsets, 0.0)[None] - slopes[:, None, None] * (along - middle)[:, None]
    count = int(np.ceil(4.0 * wide / bin_px)) + 1
    bins = np.clip(np.rint(offset_at_middle / bin_px).astype(np.int64) + count // 2, 0, count - 1)
    bins += (np.arange(_SLOPES) * count)[:, None, None]
    weight = np.broadcast_to(np.where(there, share, 0.0), offset_at_middle.shape)
    votes = np.bincount(bins.ravel(), weight.ravel(), _SLOPES * count).reshape(_SLOPES, count)
    votes[:, 1:-1] += 0.5 * (votes[:, :-2] + votes[:, 2:])
    at_middle = (np.arange(count) - count // 2) * bin_px
    votes *= 1.0 - _NEARNESS * np.minimum(np.abs(at_middle) / wide, 1.0)
    best = votes.max(axis=0)
    enough = np.flatnonzero(best >= _OUTER_SHARE * best.max())
    outer = enough[0] if inside > 0.0 else enough[-1]
    # The top of the outermost peak, not its flank.
    reach_bins = int(np.ceil(2.0 * tolerance / bin_px))
    low, high = max(outer - reach_bins, 0), outer + reach_bins + 1
    row, column = np.unravel_index(int(np.argmax(votes[:, low:high])), votes[:, low:high].shape)
    slope = float(slopes[row])
    return float(at_middle[low + column]) - slope * middle, slope


def _refined(
    profile_edges: ProfileEdges,
    along: Floats,
    start: tuple[float, float],
    tolerance: float,
    usable: int,
    sigma: float,
) -> _Line | None:
    """Least squares with Tukey's weights through each profile's edge nearest to the line."""
    offset, slope = start
    rows = np.arange(len(along))
    offsets = np.where(np.isfinite(profile_edges.offsets), profile_edges.offsets, np.inf)
    weight, rest, column = np.zeros(len(rows)), np.zeros(len(rows)), np.zeros(len(rows), np.int64)
    for _ in range(_ROUNDS):
        distance = offsets - (offset + slope * along)[:, None]
        column = np.abs(distance).argmin(axis=1)
        rest = distance[rows, column]
        size = np.abs(rest)
        near = size[size < tolerance]
        if near.size < 5:
            return None
        scale = max(1.4826 * float(np.sort(near)[near.size // 2]), 0.03)
        limit = min(4.685 * scale, 2.0 * tolerance)
        weight = np.clip(1.0 - (np.minimum(size, limit) / limit) ** 2, 0.0, None) ** 2
        rest = np.where(weight > 0.0, rest, 0.0)
        total = float(weight.sum())
        mean_along, mean_rest = float(weight @ along) / total, float(weight @ rest) / total
        centred = along - mean_along
        step = float(weight @ (centred * rest)) / max(float(weight @ centred**2), 1e-9)
        offset, slope = offset + mean_rest - step * mean_along, slope + step
    agree = np.abs(offsets[rows, column] - (offset + slope * along)) < tolerance
    if agree.sum() < 5:
        return None
    # A Gaussian edge of softness b under the filter falls off as exp(-x^2 / 2 (b^2 + sigma^2)).
    bent = np.sort(profile_edges.curvature[rows, column][agree])
    softness = float(np.sqrt(max(1.0 / max(float(bent[bent.size // 2]), 1e-3) - sigma**2, 0.04)))
    agreeing = float(np.sum(profile_edges.share[rows, column][agree])) / usable
    A = np.column_stack([np.ones_like(along), along])
    return _Line(offset, slope, _line_covariance(A, weight, rest), agreeing, softness)


def _line_covariance(A: Floats, weight: Floats, rest: Floats) -> Floats:
    """(2, 2) of offset and slope: neighbouring profiles err alike, as the residuals' own autocorrelation says."""
    used = weight > 0.0
    r, a, w = rest[used], A[used], weight[used]
    freedom = max(float(w.sum()) - 2.0, 1.0)
    variance = float(np.sum(w * r * r)) / freedom
    lags = np.arange(1, min(len(r) // 3, 16) + 1)
    correlation = np.array([float(np.sum(r[lag:] * r[:-lag])) for lag in lags]) / max(float(np.sum(r * r)), 1e-12)
    ends = np.flatnonzero(correlation < 0.0)
    leading = correlation[: ends[0]] if ends.size else correlation
    inflation = 1.0 + 2.0 * float(leading.sum())
    normal = (a * w[:, None]).T @ a + 1e-9 * np.eye(2)
    return variance * inflation * np.asarray(np.linalg.inv(normal), np.float64)


def _tangents(edges: tuple[Curve, Curve]) -> tuple[Floats, Floats]:
    """The corner (2,) and both edges' unit tangents (2, 2) there."""
    ends = [np.asarray(curve(np.array([0.0, 0.02])), np.float64) for curve in edges]
    tangents = np.array([end[1] - end[0] for end in ends])
    return ends[0][0], tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)


def inward(edges: tuple[Curve, Curve]) -> tuple[float, float]:
    """Return, for each edge, the other's component along its normal; the sign is that of offsets into the board."""
    tangents = _tangents(edges)[1]
    across = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    return float(across[0] @ tangents[1]), float(across[1] @ tangents[0])


def _system(edges: tuple[Curve, Curve], lines: Floats) -> tuple[Floats, Floats, Floats]:
    """Normals (2, 2) of both lines at the corner, their offsets (2,) from it, and the corner itself.

    A line of offset a and slope b along the edge goes through corner + a n with direction t + b n.
    """
    corner, tangents = _tangents(edges)
    across = np.column_stack([-tangents[:, 1], tangents[:, 0]])
    direction = tangents + lines[:, 1:] * across
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normals = np.column_stack([-direction[:, 1], direction[:, 0]])
    return normals, np.sum(normals * (lines[:, :1] * across), axis=1), corner


def _intersection(edges: tuple[Curve, Curve], lines: Floats) -> Floats | None:
    normals, offsets, corner = _system(edges, lines)
    if abs(float(np.linalg.det(normals))) < 0.2:
        return None
    return corner + np.linalg.solve(normals, offsets)


def _with_covariance(
    edges: tuple[Curve, Curve], lines: Floats, fits: list[_Line], softness: float, growth: list[float]
) -> CornerFit:
    normals, offsets, corner = _system(edges, lines)
    inverse = np.linalg.inv(normals)
    # At the corner a line's offset is what its own fit says there.
    variance = np.diag([float(fit.covariance[0, 0]) for fit in fits])
    extrapolation = inverse @ np.diag(growth) @ inverse.T
    pixel, covariance = corner + inverse @ offsets, inverse @ variance @ inverse.T
    return CornerFit(pixel, covariance, softness, lines, extrapolation, normals, np.zeros((2, 2)))
