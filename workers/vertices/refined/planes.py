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
_LEAST_WEIGHT = 1e-9
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
    azimuth: Floats, slope: Floats, distance: Floats, ring: NDArray[np.int64], weight: Floats,
    sigma: float, bias: float, prior: Floats,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Weighted least squares of w, and its information matrix.

    The points of a ring have an error in common, so their covariance is noise^2 I + bias^2 1 1^T. It is inverted by
    the formula of Sherman and Morrison.

    Args:
        azimuth, slope, distance, ring, weight: (N,) of points, those of one ring next to each other.
        sigma: standard deviation of a distance, metres; bias: the part of it that a ring has in common.
        prior: mean and standard deviation of the plane's two slopes, dx'/dy' and dx'/dz'.
    """
    start = 0.0
    total = 0.0
    for i in range(distance.size):
        start += (weight[i] + _LEAST_WEIGHT) / distance[i]
        total += weight[i] + _LEAST_WEIGHT
    w0 = start / total
    w = np.array([w0, 0.0, 0.0])
    info = np.zeros((3, 3))
    noise = math.sqrt(max(sigma * sigma - bias * bias, 1e-8))
    for turn in range(2):
        # Errors of the distances in the weights would not cancel, so the second turn takes the first one's plane.
        shared = (bias / noise) ** 2 if turn == 1 else 0.0
        wide = noise if turn == 1 else sigma
        info[:] = 0.0
        right = np.zeros(3)
        # Where hardly any point counts, the distance is known to a factor.
        info[0, 0], right[0] = 1.0 / w0**2, 1.0 / w0
        for k in range(2):
            # w_y + mean w_x = 0 within deviation w_x
            scale = 1.0 / (prior[2 * k + 1] * w[0]) ** 2
            mean = prior[2 * k]
            info[0, 0] += scale * mean * mean
            info[0, k + 1] += scale * mean
            info[k + 1, 0] += scale * mean
            info[k + 1, k + 1] += scale
        n, s0, s1, s2, sy = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(distance.size):
            if weight[i] > 0.0:
                h = distance[i]
                u0, u1, u2 = math.cos(azimuth[i]), math.sin(azimuth[i]), slope[i]
                near = w[0] * u0 + w[1] * u1 + w[2] * u2 if turn == 1 else 1.0 / h
                far = 1.0 / (max(near, 0.5 * w0) ** 2 * wide)
                scale = weight[i] * far * far
                info[0, 0] += scale * u0 * u0
                info[0, 1] += scale * u0 * u1
                info[0, 2] += scale * u0 * u2
                info[1, 1] += scale * u1 * u1
                info[1, 2] += scale * u1 * u2
                info[2, 2] += scale * u2 * u2
                right[0] += scale * u0 / h
                right[1] += scale * u1 / h
                right[2] += scale * u2 / h
                n += weight[i]
                s0 += weight[i] * far * u0
                s1 += weight[i] * far * u1
                s2 += weight[i] * far * u2
                sy += weight[i] * far / h
            if n > 0.0 and (i == distance.size - 1 or ring[i + 1] != ring[i]):
                less = shared / (1.0 + shared * n)
                info[0, 0] -= less * s0 * s0
                info[0, 1] -= less * s0 * s1
                info[0, 2] -= less * s0 * s2
                info[1, 1] -= less * s1 * s1
                info[1, 2] -= less * s1 * s2
                info[2, 2] -= less * s2 * s2
                right[0] -= less * s0 * sy
                right[1] -= less * s1 * sy
                right[2] -= less * s2 * sy
                n, s0, s1, s2, sy = 0.0, 0.0, 0.0, 0.0, 0.0
        info[1, 0], info[2, 0], info[2, 1] = info[0, 1], info[0, 2], info[1, 2]
        w[:] = np.linalg.solve(info, right)
    return w, info


@nb.njit(nogil=True, cache=True, error_model="numpy")
def grow_plane(
    azimuth: Floats, slope: Floats, distance: Floats, ring: NDArray[np.int64], start: NDArray[np.bool_],
    downwards: bool, sigma: float, bias: float, prior: Floats,
) -> tuple[Floats, Floats, float]:  # fmt: skip
    """The plane through the points of ``start`` and all others near it that lie on it.

    Args:
        azimuth, slope, distance, ring: (N,) of the points in the region, those of one ring next to each other.
        start: (N,) the first guess.
        downwards: whether points below those of ``start`` count, which may be the body's.
        sigma, bias, prior: as :func:`fit_plane` says.

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
    w, info = fit_plane(azimuth, slope, distance, ring, weight, sigma, bias, prior)
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
        _doubt_rings(azimuth, slope, distance, ring, weight, sigma, bias, w, info)
        w, info = fit_plane(azimuth, slope, distance, ring, weight, sigma, bias, prior)
    for k in range(2):
        t = (-w[k + 1] / w[0] - prior[2 * k]) / prior[2 * k + 1]
        score -= 0.5 * t * t
    return w, info, score


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _doubt_rings(
    azimuth: Floats, slope: Floats, distance: Floats, ring: NDArray[np.int64], weight: Floats,
    sigma: float, bias: float, w: Floats, info: Floats,
) -> None:  # fmt: skip
    """Multiply the points' weights by how likely their ring's mean lies on the plane, in place.

    A head close behind a board lies within the noise of single points, but its rings' means do not.
    """
    noise = sigma * sigma - bias * bias
    spread = np.linalg.inv(info)
    first = 0
    while first < distance.size:
        last = first
        n, mean, u0, u1, u2, far = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        while last < distance.size and ring[last] == ring[first]:
            if weight[last] > 0.0:
                c, s = math.cos(azimuth[last]), math.sin(azimuth[last])
                h = 1.0 / (w[0] * c + w[1] * s + w[2] * slope[last])
                n += weight[last]
                mean += weight[last] * (distance[last] - h)
                u0 += weight[last] * c
                u1 += weight[last] * s
                u2 += weight[last] * slope[last]
                far += weight[last] * h
            last += 1
        if n > 0.0:
            mean, u0, u1, u2, far = mean / n, u0 / n, u1 / n, u2 / n, far / n
            told = u0 * (spread[0, 0] * u0 + 2.0 * spread[0, 1] * u1 + 2.0 * spread[0, 2] * u2)
            told += u1 * (spread[1, 1] * u1 + 2.0 * spread[1, 2] * u2) + spread[2, 2] * u2 * u2
            variance = noise / n + bias * bias + told * far**4
            like = math.exp(-0.5 * mean * mean / variance) / (math.sqrt(variance) * 2.5066)
            for i in range(first, last):
                weight[i] *= like / (like + CLUTTER)
        first = last
