"""The rays that show where a plane's board ends: the last ones on it and the first ones beside it.

Every ray of a window gets a likelihood ratio: how much likelier its answer is if it meets the board than if it does
not. From a segment of points the board is followed from ring to ring, and the rays at its edges are chosen.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.planes import CLUTTER

Floats = NDArray[np.float64]
WRONG = 0.002  # share of the rays on the board that answer as if beside it
_BEST = 100.0
_DOUBTFUL = 0.3  # distances have longer tails than a normal distribution


@nb.njit(nogil=True, cache=True, error_model="numpy")
def likelihood_ratios(
    azimuth: Floats, slope: Floats, distance: Floats, w: Floats, spread: Floats, sigma: float, dropout_rate: float
) -> tuple[Floats, Floats, Floats]:
    """Return where each ray of a window meets the plane, and how much likelier its answer is on the board than off.

    Args:
        azimuth, slope, distance: (R, C).
        w: (3,) the plane; spread: (3, 3) covariance of w.
        sigma: metres, standard deviation of a distance.
        dropout_rate: share of the rays on the board that bring no return.

    Returns:
        (R, C) left and up in the plane, metres from the foot of the window's axis; (R, C) ratio, 0 behind the sensor.
    """
    rings, columns = distance.shape
    left, up, ratio = np.empty((rings, columns)), np.empty((rings, columns)), np.zeros((rings, columns))
    norm = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    n0, n1, n2 = w[0] / norm, w[1] / norm, w[2] / norm
    flat = math.sqrt(n0 * n0 + n1 * n1)
    # e_left = z x n, e_up = n x e_left
    l0, l1 = -n1 / flat, n0 / flat
    v0, v1, v2 = -n2 * l1, n2 * l0, n0 * l1 - n1 * l0
    for r in range(rings):
        for c in range(columns):
            u0, u1, u2 = math.cos(azimuth[r, c]), math.sin(azimuth[r, c]), slope[r, c]
            inverse = w[0] * u0 + w[1] * u1 + w[2] * u2
            if inverse <= 1e-6:
                left[r, c], up[r, c] = 1e6, 1e6
                continue
            h = 1.0 / inverse
            left[r, c] = h * (u0 * l0 + u1 * l1)
            up[r, c] = h * (u0 * v0 + u1 * v1 + u2 * v2)
            measured = distance[r, c]
            if measured <= 0.0:
                ratio[r, c] = dropout_rate
                continue
            variance = 0.0
            for a in range(3):
                for b in range(3):
                    ua = u0 if a == 0 else u1 if a == 1 else u2
                    ub = u0 if b == 0 else u1 if b == 1 else u2
                    variance += ua * spread[a, b] * ub
            total = math.sqrt(sigma * sigma + variance * h * h * h * h)
            behind = (measured - h) / total
            if behind < -4.0:
                ratio[r, c] = 1.0  # something stands in front and hides the board
            else:
                like = math.exp(-0.5 * behind * behind) / (total * 2.5066)
                least = _DOUBTFUL if behind < 4.0 else WRONG
                ratio[r, c] = min(max(like / CLUTTER, least), _BEST)
    return left, up, ratio


@nb.njit(nogil=True, cache=True, error_model="numpy")
def follow_board(
    left: Floats, up: Floats, ratio: Floats, inside: NDArray[np.bool_], ring: int, first: int, last: int
) -> NDArray[np.int64]:
    """Return (R, 2) the first and last column of the board on every ring, -1 where it is not.

    Args:
        ring, first, last: the segment that the board is followed from.
    """
    rings, columns = ratio.shape
    ends = np.full((rings, 2), -1, np.int64)
    for direction in (1, -1):
        a, b = left[ring, first], left[ring, last]
        low, high = min(a, b), max(a, b)
        height = up[ring, first]
        r = ring if direction == 1 else ring - 1
        missed = 0
        while 0 <= r < rings and missed < 2:
            best, n = 0, 0
            start, end = -1, -1
            s, e = -1, -1
            for c in range(columns + 1):
                good = c < columns and ratio[r, c] > 2.0 and inside[r, c]
                if good and s >= 0 and c - e <= 3:
                    e = c
                    n += 1
                elif good or c == columns:
                    if s >= 0 and n > best:
                        nearest, farthest = min(left[r, s], left[r, e]), max(left[r, s], left[r, e])
                        if nearest <= high + 0.15 and farthest >= low - 0.15:
                            best, start, end = n, s, e
                    s, e, n = c, c, 1
            if start >= 0 and abs(up[r, start] - height) < 1.0:
                ends[r, 0], ends[r, 1] = start, end
                low, high = min(left[r, start], left[r, end]), max(left[r, start], left[r, end])
                height = up[r, start]
                missed = 0
            else:
                missed += 1
            r += direction
    return ends


@nb.njit(nogil=True, cache=True, error_model="numpy")
def choose_rays(
    left: Floats, up: Floats, ratio: Floats, distance: Floats, ends: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return (K, 2) ring and column of the rays that matter for the edges."""
    rings, columns = ratio.shape
    taken = np.zeros((rings, columns), np.bool_)
    top, bottom = -1, rings
    for r in range(rings):
        if ends[r, 0] < 0:
            continue
        top = r
        bottom = min(bottom, r)
        for c in range(max(ends[r, 0] - 3, 0), min(ends[r, 1] + 4, columns)):
            edge = c < ends[r, 0] + 2 or c > ends[r, 1] - 2
            taken[r, c] = edge or (ratio[r, c] < _DOUBTFUL and distance[r, c] > 0.0)
    if top < 0:
        return np.empty((0, 2), np.int64)
    for direction in (1, -1):
        edge_ring = top if direction == 1 else bottom
        first, last = ends[edge_ring, 0], ends[edge_ring, 1]
        width = abs(left[edge_ring, last] - left[edge_ring, first])
        margin = 3.0 * abs(left[edge_ring, first] - left[edge_ring, max(first - 1, 0)]) + 0.02
        low = min(left[edge_ring, first], left[edge_ring, last]) - margin
        high = max(left[edge_ring, first], left[edge_ring, last]) + margin
        r = edge_ring + direction
        while 0 <= r < rings:
            for c in range(columns):
                taken[r, c] = low <= left[r, c] <= high
            if abs(up[r, columns // 2] - up[edge_ring, columns // 2]) > 0.7 * width + 0.1:
                break
            r += direction
    chosen = np.empty((rings * columns, 2), np.int64)
    n = 0
    for r in range(rings):
        for c in range(columns):
            if taken[r, c] and ratio[r, c] > 0.0 and ratio[r, c] != 1.0:
                chosen[n, 0], chosen[n, 1] = r, c
                n += 1
    return chosen[:n].copy()


@nb.njit(nogil=True, cache=True, error_model="numpy")
def mixed_rays(
    azimuth: Floats, slope: Floats, distance: Floats, w: Floats, nearest: float, farthest: float,
    ring: NDArray[np.int64], column: NDArray[np.int64],
) -> NDArray[np.bool_]:  # fmt: skip
    """Return which of K rays may have met both the board and something close behind it.

    A dark body and a part of the board together often return nothing. So a ray without a return is mixed, too, if a
    ray next to it has a return from close behind.

    Args:
        azimuth, slope, distance: (R, C).
        w: (3,) the plane.
        nearest, farthest: metres behind the plane that are close.
        ring, column: (K,) of the rays.
    """
    rings, columns = distance.shape
    mixed = np.zeros(ring.size, np.bool_)
    for k in range(ring.size):
        around = 0 if distance[ring[k], column[k]] > 0.0 else 1
        for r in range(max(ring[k] - around, 0), min(ring[k] + around + 1, rings)):
            for c in range(max(column[k] - around, 0), min(column[k] + around + 1, columns)):
                u = w[0] * math.cos(azimuth[r, c]) + w[1] * math.sin(azimuth[r, c]) + w[2] * slope[r, c]
                if u > 0.0 and distance[r, c] > 0.0:
                    behind = math.sqrt(1.0 + slope[r, c] * slope[r, c]) * (distance[r, c] - 1.0 / u)
                    mixed[k] |= nearest < behind < farthest
    return mixed
