"""Where two straight edges of the board meet in a frame: profiles across both, a robust line through each.

A line is fitted to the offsets of the profiles' edges from the projected edge, so that a lens may bend both alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.marks.sights import Floats, Image

HALF_WIDTHS_PX: Final = (16.0, 8.0, 4.0, 3.0)
AGREEING: Final = 0.35
_BOTH_AGREEING: Final = 1.0  # of both edges together: mere texture reaches 0.8 (development scenes)
FARTHEST_PX: Final = 30.0
_TIP_PX: Final = 6.0  # left out at the corner, which is blunt; more for large boards
_TIP_SHARE: Final = 0.05
_END_SHARE: Final = 0.06  # left out at the far end
_SHORTEST_PX: Final = 10.0  # of what is left
_MOST_PROFILES: Final = 64
_STEP_PX: Final = 0.5
_CANDIDATES: Final = 3  # edges of a profile
_NOISES: Final = 4.0
_TOLERANCE_PX: Final = (1.5, 1.0, 0.5, 0.4)
_SHARPEST_PX: Final = 1.0  # standard deviation of the derivative of a Gaussian
_SOFTEST_PX: Final = 4.0
_SOFT_SHARE: Final = 0.4
_ROUNDS: Final = 5
_HALVED_PX: Final = 4.0  # up to here the direction is known well
_SLOPES: Final = 17
_NEARNESS: Final = 0.3  # of a vote, lost at the window's rim
_OUTER_SHARE: Final = 0.7
_CROP_PX: Final = 24
_AVERAGE: Final = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0  # of five profiles
_AVERAGED: Final = float(np.linalg.norm(_AVERAGE))

Curve = Callable[[Floats], Floats]
"""Pixels (K, 2) of a board's edge at shares (K,) of its length from the corner."""


class CornerFit(NamedTuple):
    """The corner (2,) px, its covariance (2, 2) by the profiles' scatter, and how soft the edges are, px."""

    pixel: Floats
    covariance: Floats
    softness_px: float


EdgeRefusal = Literal["outside", "few_pixels", "no_edge", "moved_far"]


@dataclass(frozen=True, eq=False)
class _Traced:
    """An edge in the image at P places: pixels (P, 2), unit normals (P, 2), lengths along it from the corner (P,)."""

    pixels: Floats
    normals: Floats
    along: Floats
    length: float

    def moved(self, offset: float, slope: float) -> _Traced:
        pixels = self.pixels + (offset + slope * self.along)[:, None] * self.normals
        return _Traced(pixels, self.normals, self.along, self.length)


class _Line(NamedTuple):
    """offset + slope * along, their covariance (2, 2), the share of agreeing profiles, and the edges' softness."""

    offset: float
    slope: float
    covariance: Floats
    agreeing: float
    softness: float


class _ProfileEdges(NamedTuple):
    """The strongest edges of P profiles, C of each.

    Attributes:
        offsets: (P, C) px from the projection; not a number where a profile has fewer.
        share: (P, C) root of the strength against the profile's strongest edge. A profile agrees with a line by
            this share. Counting every edge alike, lines through mere texture reach `AGREEING` by chance.
        curvature: (P, C) of the filter's response at its peak, relative to it, 1 / px^2.
    """

    offsets: Floats
    share: Floats
    curvature: Floats


def measure_corner(
    image: Image, edges: tuple[Curve, Curve], first_half_width: float = HALF_WIDTHS_PX[0], softness: float = 1.0
) -> CornerFit | EdgeRefusal:
    """The corner where two edges meet, measured from their projections on; or why not.

    Args:
        edges: the projections of both edges from the corner on.
        first_half_width: one of `HALF_WIDTHS_PX`: those above are skipped.
        softness: standard deviation of the frame's blur, px, as far as it is known.
    """
    pair: list[_Traced] = []
    for curve in edges:
        edge = _traced(curve, image.shape[1], image.shape[0])
        if not isinstance(edge, _Traced):
            return edge
        pair.append(edge)
    inside = _inside(edges)
    crop = _Crop.around(image, np.concatenate([edge.pixels for edge in pair]))
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
        softness = float(np.clip(np.mean([line.softness for line in lines]), _SHARPEST_PX, _SOFTEST_PX))
        corner = _intersection(edges, total)
        if corner is None:
            return "no_edge"
        if np.hypot(*(corner - start)) > FARTHEST_PX:
            return "moved_far"
    if sum(line.agreeing for line in lines) < _BOTH_AGREEING:
        return "no_edge"
    return _with_covariance(edges, total, lines, softness)


def _traced(curve: Curve, width: int, height: int) -> _Traced | Literal["outside", "few_pixels"]:
    share = np.linspace(0.0, 1.0, 33)
    pixels = curve(share)
    if not np.all(np.isfinite(pixels[0])) or np.abs(pixels[0]).max() > 4.0 * (width + height):
        return "outside"
    good = np.flatnonzero(~np.isfinite(pixels).all(axis=1))
    if good.size:
        share, pixels = share[: good[0]], pixels[: good[0]]
    if len(pixels) < 3:
        return "outside"
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pixels, axis=0).T))])
    length = float(along[-1])
    first, last = max(_TIP_PX, _TIP_SHARE * length), (1.0 - _END_SHARE) * length
    if last - first < _SHORTEST_PX:
        return "few_pixels"
    count = int(min(_MOST_PROFILES, last - first)) + 1
    places = np.linspace(first, last, count)
    at = np.column_stack([np.interp(places, along, pixels[:, axis]) for axis in range(2)])
    ahead = np.column_stack([np.interp(places + 1.0, along, pixels[:, axis]) for axis in range(2)])
    behind = np.column_stack([np.interp(places - 1.0, along, pixels[:, axis]) for axis in range(2)])
    tangent = ahead - behind
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    inside = np.all((at > 1.0) & (at < (width - 2.0, height - 2.0)), axis=1)
    if inside.sum() < _SHORTEST_PX:
        return "outside"
    normals = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return _Traced(at[inside], normals[inside], places[inside], length)


@dataclass(frozen=True, eq=False)
class _Crop:
    """A part of a frame in single precision, its first pixel, and its white noise by Immerkaer's operator (1996)."""

    image: NDArray[np.float32]
    first: Floats
    noise: float

    @classmethod
    def around(cls, image: Image, pixels: Floats) -> _Crop:
        margin = HALF_WIDTHS_PX[0] + _CROP_PX
        low = np.maximum(np.floor(pixels.min(axis=0) - margin), 0.0).astype(int)
        high = np.ceil(pixels.max(axis=0) + margin).astype(int) + 1
        part = image[low[1] : high[1], low[0] : high[0]].astype(np.float32)
        laplacian = cv2.filter2D(part, -1, np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32))
        # The operator's norm is 6; the median, because edges answer it too.
        noise = float(np.median(np.abs(laplacian))) / 0.6745 / 6.0
        return cls(part, low.astype(np.float64), max(noise, 0.2))

    def sampled(self, places: Floats) -> Floats:
        """Grey levels (...) at pixels (..., 2); not a number outside."""
        at = (places - self.first).astype(np.float32)
        values = cv2.remap(
            self.image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
        )
        return np.asarray(values, np.float64)


def _fit(
    crop: _Crop, edge: _Traced, half_width: float, tolerance: float, softness: float, inside: float
) -> _Line | None:
    """The outermost line that most profiles agree on; the sign of `inside` is that of offsets into the board."""
    wide = max(half_width, 2.5 * softness)
    sigma = float(np.clip(softness, _SHARPEST_PX, _SOFTEST_PX))
    pad = np.ceil(3.0 * sigma / _STEP_PX) * _STEP_PX
    across = np.arange(-wide - pad, wide + pad + 0.5 * _STEP_PX, _STEP_PX)
    profiles = crop.sampled(edge.pixels[:, None] + across[None, :, None] * edge.normals[:, None])
    usable = int(np.isfinite(profiles).all(axis=1).sum())
    if usable < _SHORTEST_PX:
        return None
    # Neighbouring profiles are averaged: their noise and the texture behind the board do not repeat along an edge.
    averaged = cv2.sepFilter2D(profiles, -1, np.ones(1), _AVERAGE, borderType=cv2.BORDER_REPLICATE)
    found = _edges_of(np.asarray(averaged, np.float64), across, wide, sigma, _AVERAGED * crop.noise)
    tolerance = max(tolerance, _SOFT_SHARE * softness)
    start = _voted(found, edge.along, wide, tolerance, inside)
    return _refined(found, edge.along, start, tolerance, usable, sigma)


def _edges_of(profiles: Floats, across: Floats, wide: float, sigma: float, noise: float) -> _ProfileEdges:
    """The strongest edges of each profile (P, S) of grey levels at offsets (S,)."""
    reach = int(np.ceil(3.0 * sigma / _STEP_PX))
    taps: Floats = _STEP_PX * np.arange(-reach, reach + 1, dtype=np.float64)
    kernel: Floats = taps / sigma**2 * np.exp(-0.5 * (taps / sigma) ** 2)
    kernel /= np.sum(kernel * taps)  # a ramp of one level a pixel gives one
    filled = np.where(np.isfinite(profiles), profiles, 0.0).astype(np.float32)
    slope = cv2.filter2D(filled, cv2.CV_32F, kernel[None], borderType=cv2.BORDER_REPLICATE)
    slope = np.where(np.isfinite(profiles).all(axis=1, keepdims=True), slope, 0.0)
    size = np.abs(slope)
    peak = (size[:, 1:-1] >= size[:, :-2]) & (size[:, 1:-1] > size[:, 2:])
    # Neighbouring samples share pixels: the filter's noise is that of one sample for each pixel.
    floor = _NOISES * noise * float(np.sqrt(np.sum(kernel**2) / _STEP_PX))
    peak &= (np.abs(across[1:-1]) <= wide) & (size[:, 1:-1] > floor)
    score = np.where(peak, size[:, 1:-1], 0.0)
    order = np.argsort(-score, axis=1)[:, :_CANDIDATES]
    rows = np.arange(len(score))[:, None]
    strength = score[rows, order]
    left, middle, right = (size[rows, order + k] for k in range(3))
    bend = left - 2.0 * middle + right
    shift = np.where(bend < 0.0, 0.5 * (left - right) / np.where(bend < 0.0, bend, -1.0), 0.0)
    offsets = across[1:-1][order] + _STEP_PX * np.clip(shift, -0.5, 0.5)
    curvature = -bend / _STEP_PX**2 / np.maximum(middle, 1e-9)
    share = np.sqrt(strength / np.maximum(strength[:, :1], 1e-9))
    return _ProfileEdges(np.where(strength > 0.0, offsets, np.nan), share, curvature)


def _voted(found: _ProfileEdges, along: Floats, wide: float, tolerance: float, inside: float) -> tuple[float, float]:
    """Offset and slope of a line that many profiles have an edge on, a Hough transform over both.

    A pattern has lines of its own, which may be the stronger ones: of lines with nearly as many profiles as the best
    the outermost is taken.
    """
    offsets, share = found.offsets, found.share
    reach = float(along[-1] - along[0])
    middle = 0.5 * float(along[-1] + along[0])
    bin_px = 0.5 * tolerance
    steepest = (wide if wide > _HALVED_PX else 0.5 * wide) / max(0.5 * reach, 1.0)
    slopes = np.linspace(-steepest, steepest, _SLOPES)
    there = np.isfinite(offsets)
    place = np.where(there, offsets, 0.0)[None] - slopes[:, None, None] * (along - middle)[:, None]
    count = int(np.ceil(4.0 * wide / bin_px)) + 1
    bins = np.clip(np.rint(place / bin_px).astype(np.int64) + count // 2, 0, count - 1)
    bins += (np.arange(_SLOPES) * count)[:, None, None]
    weight = np.broadcast_to(np.where(there, share, 0.0), place.shape)
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
    profile_edges: _ProfileEdges,
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
    kept = correlation[: ends[0]] if ends.size else correlation
    inflation = 1.0 + 2.0 * float(kept.sum())
    normal = (a * w[:, None]).T @ a + 1e-9 * np.eye(2)
    return variance * inflation * np.asarray(np.linalg.inv(normal), np.float64)


def _tangents(edges: tuple[Curve, Curve]) -> tuple[Floats, Floats]:
    """The corner (2,) and both edges' unit tangents (2, 2) there."""
    ends = [np.asarray(curve(np.array([0.0, 0.02])), np.float64) for curve in edges]
    tangents = np.array([end[1] - end[0] for end in ends])
    return ends[0][0], tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)


def _inside(edges: tuple[Curve, Curve]) -> tuple[float, float]:
    """For each edge, the component of the other one along its normal: the sign is that of offsets into the board."""
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


def _with_covariance(edges: tuple[Curve, Curve], lines: Floats, fits: list[_Line], softness: float) -> CornerFit:
    normals, offsets, corner = _system(edges, lines)
    inverse = np.linalg.inv(normals)
    # At the corner a line's offset is what its own fit says there.
    variance = np.diag([float(fit.covariance[0, 0]) for fit in fits])
    return CornerFit(corner + inverse @ offsets, inverse @ variance @ inverse.T, softness)
