"""A straight edge of the board in a frame: profiles across its projection, and the line that most of them agree on.

A Hough transform finds the line, and least squares with Tukey's weights refine it. Cut boards are not quite straight,
so the fit may bend: over a long edge the bend decides where the corner is.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np

from workers.marks.profiles import (
    SHARPEST_PX,
    SHORTEST_PX,
    SOFTEST_PX,
    STEP_PX,
    Crop,
    ProfileEdges,
    TracedEdge,
    find_edges,
)
from workers.marks.sights import Floats

_SOFT_SHARE: Final = 0.4
_ROUNDS: Final = 5
_SAG: Final = 0.001
"""Deviation of an edge's middle from the line through its ends, of its length: cut boards may be off by 1 to 2 mm a
metre (tolerances of plywood after EN 315)."""
_LEAST_SCATTER_PX: Final = 0.03
_HALVED_PX: Final = 4.0  # up to here the direction is known well
_SLOPES: Final = 17
_NEARNESS: Final = 0.3  # of a vote, lost at the window's rim
_OUTER_SHARE: Final = 0.7
_AVERAGE: Final = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0  # of five profiles
_AVERAGED: Final = float(np.linalg.norm(_AVERAGE))


class EdgeLine(NamedTuple):
    """offset + slope * along, and what its bend adds to both at the corner; the offset's variance there.

    `agreeing` is the share of agreeing profiles.
    """

    offset: float
    slope: float
    bend: tuple[float, float]
    variance: float
    agreeing: float
    softness: float


def fit_edge(
    crop: Crop, edge: TracedEdge, half_width: float, tolerance: float, softness: float, inside: float
) -> EdgeLine | None:
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
) -> EdgeLine | None:
    """Least squares with Tukey's weights through each profile's edge nearest to the line."""
    offset, slope = start
    rows = np.arange(len(along))
    offsets = np.where(np.isfinite(profile_edges.offsets), profile_edges.offsets, np.inf)
    A = _bent_line(along)
    line = np.array([offset, slope, 0.0])
    weight, rest, column = np.zeros(len(rows)), np.zeros(len(rows)), np.zeros(len(rows), np.int64)
    covariance = np.zeros((3, 3))
    for _ in range(_ROUNDS):
        distance = offsets - (A @ line)[:, None]
        column = np.abs(distance).argmin(axis=1)
        rest = distance[rows, column]
        size = np.abs(rest)
        near = size[size < tolerance]
        if near.size < 5:
            return None
        scale = max(1.4826 * float(np.sort(near)[near.size // 2]), _LEAST_SCATTER_PX)
        limit = min(4.685 * scale, 2.0 * tolerance)
        weight = np.clip(1.0 - (np.minimum(size, limit) / limit) ** 2, 0.0, None) ** 2
        rest = np.where(weight > 0.0, rest, 0.0)
        step, covariance = _step(A, weight, rest, line)
        line = line + step
    offset, slope, bend = line.tolist()
    agree = np.abs(offsets[rows, column] - A @ line) < tolerance
    if agree.sum() < 5:
        return None
    # A Gaussian edge of softness b under the filter falls off as exp(-x^2 / 2 (b^2 + sigma^2)).
    bent = np.sort(profile_edges.curvature[rows, column][agree])
    softness = float(np.sqrt(max(1.0 / max(float(bent[bent.size // 2]), 1e-3) - sigma**2, 0.04)))
    agreeing = float(np.sum(profile_edges.share[rows, column][agree])) / usable
    # At the corner the line's offset is what its own fit says there.
    at_corner, ahead = _bent_line(along, np.array([0.0, 1.0]))
    variance = float(at_corner @ covariance @ at_corner)
    at_end = bend * float(at_corner[2]), bend * float(ahead[2] - at_corner[2])
    return EdgeLine(offset, slope, at_end, variance, agreeing, softness)


def _bent_line(along: Floats, places: Floats | None = None) -> Floats:
    """(P, 3) a line and a bend at places (P,): 1, the place, and a parabola of height 1 over the edge seen."""
    at = along if places is None else places
    half = max(0.5 * float(along[-1] - along[0]), 1.0)
    share = (at - 0.5 * float(along[-1] + along[0])) / half
    return np.column_stack([np.ones_like(at), at, share**2 - 1.0 / 3.0])


def _step(A: Floats, weight: Floats, rest: Floats, line: Floats) -> tuple[Floats, Floats]:
    """(3,) least squares, the bend as straight as boards are, and (3, 3) covariance.

    Neighbouring profiles err alike, as the residuals' own autocorrelation says.
    """
    used = weight > 0.0
    r, a, w = rest[used], A[used], weight[used]
    freedom = max(float(w.sum()) - 3.0, 1.0)
    variance = max(float(np.sum(w * r * r)) / freedom, 1e-9)
    lags = np.arange(1, min(len(r) // 3, 16) + 1)
    correlation = np.array([float(np.sum(r[lag:] * r[:-lag])) for lag in lags]) / max(float(np.sum(r * r)), 1e-12)
    ends = np.flatnonzero(correlation < 0.0)
    leading = correlation[: ends[0]] if ends.size else correlation
    variance *= 1.0 + 2.0 * float(leading.sum())
    straight = np.diag([1e-9, 1e-9, 1.0 / (_SAG * float(A[-1, 1] - A[0, 1])) ** 2])
    covariance = np.asarray(np.linalg.inv((a * w[:, None]).T @ a / variance + straight), np.float64)
    step: Floats = covariance @ ((a * w[:, None]).T @ r / variance - straight @ line)
    return step, covariance
