"""Where a board's plane could be: pairs of neighbouring stretches of points on rings, grown robustly.

A plane that does not pass through the sensor is w . X = 1, so a ray (c, s, k) h meets it at 1 / h = w . (c, s, k): a
linear least squares whose matrix holds directions only, and no noisy ranges.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
CLUTTER = 0.5  # density, per metre of depth, of returns near the board that are not the board's


@nb.njit(nogil=True, cache=True, error_model="numpy")
def find_stretches(
    azimuth: Floats, distance: Floats, inside: NDArray[np.bool_], sigma: float, steps: Floats
) -> NDArray[np.float64]:
    """Runs of returns in the region whose distance does not jump.

    Returns:
        (S, 7) ring, first column, last column, points, y' of the first and of the last point, mean x'; metres.
    """
    rings, columns = distance.shape
    found = np.empty((rings * columns // 2 + 1, 7))
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
                found[count, 0], found[count, 1], found[count, 2], found[count, 3] = r, first, last, n
                found[count, 4] = distance[r, first] * math.sin(azimuth[r, first])
                found[count, 5] = distance[r, last] * math.sin(azimuth[r, last])
                found[count, 6] = total / n
                count += 1
                n, total = 0, 0.0
            if is_point:
                if not joined:
                    first = c
                last = c
                n += 1
                total += distance[r, c] * math.cos(azimuth[r, c])
    return found[:count].copy()


@nb.njit(nogil=True, cache=True, error_model="numpy")
def pair_stretches(stretches: Floats, slope: Floats, widest: float, most: int) -> NDArray[np.int64]:
    """(K, 2) pairs (upper, lower) on neighbouring filled rings that could lie on one board, the largest first."""
    count = stretches.shape[0]
    middle = slope.shape[1] // 2
    pairs = np.empty((count * 6 + 1, 2), np.int64)
    points = np.empty(count * 6 + 1)
    n = 0
    for i in range(count):
        ring = stretches[i, 0]
        partner_ring = -1.0
        for j in range(i - 1, -1, -1):
            below = stretches[j, 0]
            if below == ring or stretches[j, 5] - stretches[j, 4] > widest:
                continue
            if (partner_ring >= 0.0 and below != partner_ring) or n >= pairs.shape[0] - 1:
                break
            if ring - below > 3:
                break
            rise = stretches[i, 6] * (slope[int(ring), middle] - slope[int(below), middle])
            gap = max(stretches[j, 4] - stretches[i, 5], stretches[i, 4] - stretches[j, 5])
            near = abs(stretches[i, 6] - stretches[j, 6]) <= 0.1 + 0.5 * rise
            if rise < 1.2 and gap <= 0.15 and near and stretches[i, 5] - stretches[i, 4] <= widest:
                partner_ring = below
                pairs[n, 0], pairs[n, 1] = i, j
                points[n] = stretches[i, 3] + stretches[j, 3]
                n += 1
    order = np.argsort(-points[:n], kind="mergesort")
    return pairs[order[:most]]


@nb.njit(nogil=True, cache=True, error_model="numpy")
def fit_plane(
    azimuth: Floats, slope: Floats, distance: Floats, weight: Floats, sigma: float, prior: Floats
) -> tuple[Floats, Floats]:
    """Weighted least squares of w, and its information matrix.

    Args:
        azimuth, slope, distance, weight: (N,) of points.
        sigma: standard deviation of a distance, metres.
        prior: mean and standard deviation of the plane's two slopes, dx'/dy' and dx'/dz'.
    """
    start = 0.0
    total = 0.0
    for i in range(distance.size):
        start += weight[i] / distance[i]
        total += weight[i]
    w0 = start / max(total, 1e-12)
    w = np.array([w0, 0.0, 0.0])
    info = np.zeros((3, 3))
    for _ in range(2):
        info[:] = 0.0
        right = np.zeros(3)
        for k in range(2):
            # w_y + mean w_x = 0 within deviation w_x
            scale = 1.0 / (prior[2 * k + 1] * w[0]) ** 2
            mean = prior[2 * k]
            info[0, 0] += scale * mean * mean
            info[0, k + 1] += scale * mean
            info[k + 1, 0] += scale * mean
            info[k + 1, k + 1] += scale
        for i in range(distance.size):
            if weight[i] <= 0.0:
                continue
            h = distance[i]
            u0, u1, u2 = math.cos(azimuth[i]), math.sin(azimuth[i]), slope[i]
            scale = weight[i] * (h * h / sigma) ** 2
            info[0, 0] += scale * u0 * u0
            info[0, 1] += scale * u0 * u1
            info[0, 2] += scale * u0 * u2
            info[1, 1] += scale * u1 * u1
            info[1, 2] += scale * u1 * u2
            info[2, 2] += scale * u2 * u2
            right[0] += scale * u0 / h
            right[1] += scale * u1 / h
            right[2] += scale * u2 / h
        info[1, 0], info[2, 0], info[2, 1] = info[0, 1], info[0, 2], info[1, 2]
        w[:] = np.linalg.solve(info, right)
    return w, info


@nb.njit(nogil=True, cache=True, error_model="numpy")
def grow_plane(
    azimuth: Floats,
    slope: Floats,
    distance: Floats,
    start: NDArray[np.bool_],
    downwards: bool,
    sigma: float,
    prior: Floats,
) -> tuple[Floats, Floats, float]:
    """The plane through the points of ``start`` and all others near it that lie on it.

    Args:
        azimuth, slope, distance: (N,) of the points in the region.
        start: (N,) the first guess.
        downwards: whether points below those of ``start`` count, which may be the body's.

    Returns:
        w (3,), its information (3, 3), and the log likelihood of the points against clutter, prior included.
    """
    count = distance.size
    weight = np.empty(count)
    y, z, n = 0.0, 0.0, 0
    lowest = math.inf
    for i in range(count):
        weight[i] = 1.0 if start[i] else 0.0
        if start[i]:
            y += distance[i] * azimuth[i]
            z += distance[i] * slope[i]
            lowest = min(lowest, distance[i] * slope[i] - 0.1)
            n += 1
    y /= n
    z /= n
    w, info = fit_plane(azimuth, slope, distance, weight, sigma, prior)
    score = 0.0
    for turn in range(5):
        wide = sigma * (3.0 if turn == 0 else 2.0 if turn == 1 else 1.0)
        score = 0.0
        for i in range(count):
            weight[i] = 0.0
            if abs(distance[i] * azimuth[i] - y) > 0.8 or abs(distance[i] * slope[i] - z) > 1.3:
                continue
            u = w[0] * math.cos(azimuth[i]) + w[1] * math.sin(azimuth[i]) + w[2] * slope[i]
            if u <= 0.0:
                continue
            z_score = (distance[i] - 1.0 / u) / wide
            like = math.exp(-0.5 * z_score * z_score) / (wide * 2.5066) + 1e-12
            if downwards or distance[i] * slope[i] > lowest:
                weight[i] = like / (like + CLUTTER)
            score += math.log1p(like / CLUTTER)
        w, info = fit_plane(azimuth, slope, distance, weight, sigma, prior)
    for k in range(2):
        t = (-w[k + 1] / w[0] - prior[2 * k]) / prior[2 * k + 1]
        score -= 0.5 * t * t
    return w, info, score
