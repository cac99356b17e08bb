"""Planes that may be a board's: each grows from two segments of points on neighbouring rings, robustly.

A plane that does not pass through the sensor is w . X = 1, so a ray (c, s, k) h meets it at 1 / h = w . (c, s, k): a
linear least squares whose matrix holds directions only, and no noisy ranges. Points join a plane by weights that
compare the board's density with that of clutter, and each fit is repeated with the new weights (iteratively
reweighted least squares).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
CLUTTER = 0.5  # density, per metre of depth, of returns near the board that are not the board's
_BELOW_M = 0.1
_ALIKE = 0.003
_FAR = 8.0  # standard deviations; the normal density is 1e-14 of its highest there


@nb.njit(nogil=True, cache=True, error_model="numpy")
def find_segments(
    azimuth: Floats, distance: Floats, inside: NDArray[np.bool_], sigma: float, steps: Floats
) -> NDArray[np.float64]:
    """Return the runs of returns in the region whose distance does not jump.

    Returns:
        (S, 7) ring, first column, last column, points, y' of the first and of the last point, mean x'; metres.
    """
    rings, columns = distance.shape
    segments = np.empty((inside.sum(), 7))  # every point may be a segment of its own
    count = 0
    for r in range(rings):
        first, last, n, total = -1, -1, 0, 0.0
        for c in range(columns + 1):
            is_point = c < columns and distance[r, c] > 0.0 and inside[r, c]
            if not is_point and c < columns:
                continue
            joined = False
            if is_point and last >= 0:
                h = distance[r, c]
                jump = 5.0 * sigma + 1.2 * h * steps[r] * (c - last)
                joined = c - last <= 3 and abs(h - distance[r, last]) <= jump
            if last >= 0 and not joined:
                segments[count, 0], segments[count, 1], segments[count, 2], segments[count, 3] = r, first, last, n
                segments[count, 4] = distance[r, first] * math.sin(azimuth[r, first])
                segments[count, 5] = distance[r, last] * math.sin(azimuth[r, last])
                segments[count, 6] = total / n
                count += 1
                n, total = 0, 0.0
            if is_point:
                if not joined:
                    first = c
                last = c
                n += 1
                total += distance[r, c] * math.cos(azimuth[r, c])
    return segments[:count].copy()


@nb.njit(nogil=True, cache=True, error_model="numpy")
def pair_segments(segments: Floats, slope: Floats, widest: float, most: int) -> NDArray[np.int64]:
    """Return (K, 2) pairs (upper, lower) of segments that could lie on one board, the largest first.

    The rings of a pair are neighbours among those with points.
    """
    count = segments.shape[0]
    middle = slope.shape[1] // 2
    pairs = np.empty((count * 6 + 1, 2), np.int64)
    points = np.empty(count * 6 + 1)
    n = 0
    for i in range(count):
        ring = segments[i, 0]
        partner_ring = -1.0
        for j in range(i - 1, -1, -1):
            below = segments[j, 0]
            if below == ring or segments[j, 5] - segments[j, 4] > widest:
                continue
            if (partner_ring >= 0.0 and below != partner_ring) or n >= pairs.shape[0] - 1:
                break
            if ring - below > 3:
                break
            rise = segments[i, 6] * (slope[int(ring), middle] - slope[int(below), middle])
            gap = max(segments[j, 4] - segments[i, 5], segments[i, 4] - segments[j, 5])
            near = abs(segments[i, 6] - segments[j, 6]) <= 0.1 + 0.5 * rise
            if rise < 1.2 and gap <= 0.15 and near and segments[i, 5] - segments[i, 4] <= widest:
                partner_ring = below
                pairs[n, 0], pairs[n, 1] = i, j
                points[n] = segments[i, 3] + segments[j, 3]
                n += 1
    order = np.argsort(-points[:n], kind="mergesort")
    return pairs[order[:most]]


@nb.njit(nogil=True, cache=True, error_model="numpy")
def fit_plane(
    azimuth: Floats, slope: Floats, distance: Floats, weight: Floats, sigma: float, prior: Floats
) -> tuple[Floats, Floats]:
    """Return w (3,) of a plane by weighted least squares, and its information matrix (3, 3).

    Args:
        azimuth, slope, distance, weight: (N,) of points.
        sigma: standard deviation of a distance, metres.
        prior: (4,) mean and standard deviation of the plane's two slopes, dx'/dy' and dx'/dz'.
    """
    w, info = np.empty(3), np.empty((3, 3))
    _fit(np.cos(azimuth), np.sin(azimuth), slope, distance, weight, sigma, prior, w, info)
    return w, info


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _fit(
    cosine: Floats, sine: Floats, slope: Floats, distance: Floats, weight: Floats, sigma: float, prior: Floats,
    w: Floats, info: Floats,
) -> None:  # fmt: skip
    """Fill ``w`` and ``info`` as `fit_plane` returns them, of points whose azimuths have these cosines and sines."""
    start = 0.0
    total = 0.0
    for i in range(distance.size):
        start += weight[i] / distance[i]
        total += weight[i]
    w[0], w[1], w[2] = start / max(total, 1e-12), 0.0, 0.0
    for _ in range(2):
        info[:] = 0.0
        b0 = b1 = b2 = 0.0
        for k in range(2):
            # w_y + mean w_x = 0 within deviation w_x
            scale = 1.0 / (prior[2 * k + 1] * w[0]) ** 2
            mean = prior[2 * k]
            info[0, 0] += scale * mean * mean
            info[0, k + 1] += scale * mean
            info[k + 1, k + 1] += scale
        for i in range(distance.size):
            if weight[i] <= 0.0:
                continue
            h = distance[i]
            u0, u1, u2 = cosine[i], sine[i], slope[i]
            scale = weight[i] * (h * h / sigma) ** 2
            info[0, 0] += scale * u0 * u0
            info[0, 1] += scale * u0 * u1
            info[0, 2] += scale * u0 * u2
            info[1, 1] += scale * u1 * u1
            info[1, 2] += scale * u1 * u2
            info[2, 2] += scale * u2 * u2
            b0 += scale * u0 / h
            b1 += scale * u1 / h
            b2 += scale * u2 / h
        info[1, 0], info[2, 0], info[2, 1] = info[0, 1], info[0, 2], info[1, 2]
        # Cholesky: info = L L^T.
        l00 = math.sqrt(info[0, 0])
        l10, l20 = info[1, 0] / l00, info[2, 0] / l00
        l11 = math.sqrt(info[1, 1] - l10 * l10)
        l21 = (info[2, 1] - l20 * l10) / l11
        l22 = math.sqrt(info[2, 2] - l20 * l20 - l21 * l21)
        y0 = b0 / l00
        y1 = (b1 - l10 * y0) / l11
        w[2] = (b2 - l20 * y0 - l21 * y1) / (l22 * l22)
        w[1] = (y1 - l21 * w[2]) / l11
        w[0] = (y0 - l10 * w[1] - l20 * w[2]) / l00


@nb.njit(nogil=True, cache=True, error_model="numpy")
def grow_planes(
    azimuth: Floats, slope: Floats, distance: Floats, inside: NDArray[np.bool_],
    segments: Floats, pairs: NDArray[np.int64], sigma: float, prior: Floats,
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:  # fmt: skip
    """Return the distinct planes that grow from pairs of segments, each with all nearby points that lie on it.

    Args:
        azimuth, slope, distance, inside: (R, C) of a window.
        segments: see `find_segments`; pairs: see `pair_segments`.
        sigma, prior: see `fit_plane`.

    Returns:
        (K, 3) w; (K, 3, 3) its information; (K,) log likelihood of the points against clutter, prior included; (K,)
        index of the pair.
    """
    ring, column = np.nonzero(inside)
    count = ring.size
    angle, rise, reach = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        r, c = ring[i], column[i]
        angle[i], rise[i], reach[i] = azimuth[r, c], slope[r, c], distance[r, c]
    cosine, sine = np.cos(angle), np.sin(angle)
    most = 2 * pairs.shape[0]
    planes, infos, scores = np.empty((most, 3)), np.empty((most, 3, 3)), np.empty(most)
    pair_of = np.empty(most, np.int64)
    plane_count = 0
    start, near = np.empty(count, np.bool_), np.empty(count, np.bool_)
    for number in range(pairs.shape[0]):
        y, z, n = 0.0, 0.0, 0
        lowest = math.inf
        for i in range(count):
            start[i] = False
            for segment in pairs[number]:
                start[i] |= (
                    ring[i] == segments[segment, 0] and segments[segment, 1] <= column[i] <= segments[segment, 2]
                )
            if start[i]:
                y += reach[i] * angle[i]
                z += reach[i] * rise[i]
                lowest = min(lowest, reach[i] * rise[i] - _BELOW_M)
                n += 1
        y /= n
        z /= n
        for i in range(count):
            near[i] = not (abs(reach[i] * angle[i] - y) > 0.8 or abs(reach[i] * rise[i] - z) > 1.3)
        some = np.flatnonzero(near | start)
        c, s, k, h = cosine[some], sine[some], rise[some], reach[some]
        first, counted = start[some], near[some]
        # Points below those of the pair may be a body's: grow once with them, and once without.
        for from_height in (-math.inf, lowest):
            w, info = planes[plane_count], infos[plane_count]
            scores[plane_count] = _grow(c, s, k, h, first, counted, from_height, sigma, prior, w, info)
            is_known = False
            for other in range(plane_count):
                is_known |= np.max(np.abs(planes[other] - w)) < _ALIKE * abs(w[0])
            if not is_known:
                pair_of[plane_count] = number
                plane_count += 1
    return planes[:plane_count], infos[:plane_count], scores[:plane_count], pair_of[:plane_count]


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _grow(
    cosine: Floats, sine: Floats, slope: Floats, distance: Floats, start: NDArray[np.bool_], near: NDArray[np.bool_],
    lowest: float, sigma: float, prior: Floats, w: Floats, info: Floats,
) -> float:  # fmt: skip
    """Fill ``w`` and ``info`` of the plane that grows from the points of ``start``; return its score.

    Args:
        near: (N,) the points that may join.
        lowest: metres, height of the lowest point that counts.
    """
    weight = np.where(start, 1.0, 0.0)
    _fit(cosine, sine, slope, distance, weight, sigma, prior, w, info)
    score = 0.0
    for turn in range(5):
        wide = sigma * (3.0 if turn == 0 else 2.0 if turn == 1 else 1.0)
        score = 0.0
        for i in range(distance.size):
            weight[i] = 0.0
            if not near[i]:
                continue
            u = w[0] * cosine[i] + w[1] * sine[i] + w[2] * slope[i]
            if u <= 0.0:
                continue
            z_score = (distance[i] - 1.0 / u) / wide
            if abs(z_score) > _FAR:
                continue
            like = math.exp(-0.5 * z_score * z_score) / (wide * 2.5066)
            if distance[i] * slope[i] > lowest:
                weight[i] = like / (like + CLUTTER)
            score += math.log1p(like / CLUTTER)
        _fit(cosine, sine, slope, distance, weight, sigma, prior, w, info)
    for k in range(2):
        t = (-w[k + 1] / w[0] - prior[2 * k]) / prior[2 * k + 1]
        score -= 0.5 * t * t
    return score
