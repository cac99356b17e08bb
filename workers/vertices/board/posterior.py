"""The posterior of a board's apex and roll in its plane, from rays that meet the board and rays that miss it.

In the plane, with the roll fixed, a point's distances to the four edges are differences of coordinates along the two
edges. So the probability that a ray lies on the board is a product g(p) h(q), and the likelihood of a ray over a grid
of apexes is 1 + (lambda - 1) g(p) h(q): at most one multiplication and one addition for each cell and ray. That is
cheap enough to sum the posterior over a grid instead of sampling it.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.outline import ALL, NOTHING, Floats, edge_profile

_COARSE, _FINE, _COMPARED = 24, 36, 20  # cells along either side of the grid
_ROLLS = 9
_ROLL_STEP = math.radians(0.9)  # standard deviation of the prior for each roll of the first pass
_ROLL_REACH = 2.8  # standard deviations of the prior that the first pass covers
_ASTRAY_M = 0.12  # hits that do not belong to the board lie this far beside it at most
# The natural logarithm of the largest number is 709: cells are scaled before they may differ so much from 1.
_MOST_LOG = 300.0


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _rescale(grid: Floats, row: Floats, column: Floats) -> float:
    """Move the rows' and columns' factors into the cells, divide by the largest cell, and return its logarithm."""
    most = 0.0
    for a in range(row.size):
        for b in range(column.size):
            grid[a, b] *= row[a] * column[b]
            most = max(most, grid[a, b])
    row[:], column[:] = 1.0, 1.0
    if most <= 0.0:
        return 0.0
    grid *= 1.0 / most
    return math.log(most)


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def integrate(
    left: Floats, up: Floats, blooming_m: Floats, softness: Floats, ratio: Floats,
    edge_p: float, edge_q: float, slack: float,
    rolls: Floats, log_prior: Floats, centre: Floats, half: Floats, cells: int,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return the moments of the posterior over (apex left, apex up, roll).

    Args:
        left, up: (N,) metres, where each ray meets the plane.
        blooming_m: (N,) metres by which the edges appear shifted outward at the ray.
        softness: (N,) metres, half width of the step at an edge.
        ratio: (N,) likelihood of the ray's answer with the board over that without it.
        edge_p, edge_q: metres, edges to the lower left and to the lower right.
        slack: metres, half width of the interval in which each edge's length may lie.
        rolls: (K,) radians, evenly spaced; log_prior: (K,).
        centre: (K, 2) p and q of the grid's middle at each roll, metres; half: (K, 2) half widths of the grid.
        cells: grid cells along either side.

    Returns:
        (11,) log evidence, mean left, up, roll, covariance (ll, uu, rr, lu, lr, ur), best log likelihood; and (K, 5)
        for each roll, log evidence without the prior, mean p and q of the apex, and their standard deviations.
    """
    rays = left.size
    grid, row, column = np.empty((cells, cells)), np.empty(cells), np.empty(cells)
    on_p, on_q, peak = np.empty(cells), np.empty(cells), np.empty(cells)
    far, log_ratio = np.empty(rays), np.empty(rays)
    outside = 0.0
    for i in range(rays):
        far[i] = math.sqrt(softness[i] * softness[i] + slack * slack)
        log_ratio[i] = math.log(max(ratio[i], 1e-300))
        outside -= max(log_ratio[i], 0.0)
    best = -1e300
    s0 = s1 = s2 = s3 = 0.0
    m11 = m22 = m33 = m12 = m13 = m23 = 0.0
    # Moments about the middle of the grid.
    mid = rolls.size // 2
    middle = rolls[mid]
    cm, sm = math.cos(middle), math.sin(middle)
    l0, u0 = centre[mid, 0] * cm - centre[mid, 1] * sm, -centre[mid, 0] * sm - centre[mid, 1] * cm
    scale = -1e300
    out, by_roll = np.zeros(11), np.zeros((rolls.size, 5))
    for k in range(rolls.size):
        cosine, sine = math.cos(rolls[k]), math.sin(rolls[k])
        cell_p, cell_q = 2.0 * half[k, 0] / cells, 2.0 * half[k, 1] / cells
        p0 = centre[k, 0] - half[k, 0] + 0.5 * cell_p
        q0 = centre[k, 1] - half[k, 1] + 0.5 * cell_q
        # A cell's likelihood is the product of its row's, its column's and its own part.
        grid[:], row[:], column[:] = 1.0, 1.0, 1.0
        offset, swing = outside, 0.0
        for i in range(rays):
            p = left[i] * cosine - up[i] * sine - p0
            q = -left[i] * sine - up[i] * cosine - q0
            kind_p = edge_profile(p, cell_p, blooming_m[i], softness[i], far[i], edge_p, on_p)
            kind_q = (
                edge_profile(q, cell_q, blooming_m[i], softness[i], far[i], edge_q, on_q)
                if kind_p != NOTHING
                else NOTHING
            )
            if kind_q == NOTHING:
                continue
            if kind_p == ALL and kind_q == ALL:
                offset += log_ratio[i]
                continue
            gain = ratio[i] - 1.0
            if kind_p == ALL:
                for b in range(cells):
                    column[b] *= 1.0 + gain * on_q[b]
            elif kind_q == ALL:
                for a in range(cells):
                    row[a] *= 1.0 + gain * on_p[a]
            else:
                for a in range(cells):
                    if on_p[a] != 0.0:
                        g = gain * on_p[a]
                        for b in range(cells):
                            grid[a, b] *= 1.0 + g * on_q[b]
            swing += abs(log_ratio[i])
            if swing > _MOST_LOG:
                offset += _rescale(grid, row, column)
                swing = 0.0
        peak[:] = 0.0
        n = n1 = n2 = n11 = n22 = n12 = 0.0
        for a in range(cells):
            p = p0 + a * cell_p - centre[k, 0]
            w = w2 = w22 = 0.0
            for b in range(cells):
                weight = grid[a, b] * column[b]
                q = q0 + b * cell_q - centre[k, 1]
                w += weight
                w2 += weight * q
                w22 += weight * q * q
                peak[b] = max(peak[b], weight * row[a])
            n += row[a] * w
            n1 += row[a] * w * p
            n2 += row[a] * w2
            n11 += row[a] * w * p * p
            n12 += row[a] * w2 * p
            n22 += row[a] * w22
        highest = np.max(peak)
        if highest <= 0.0:
            by_roll[k, 0] = -1e300
            by_roll[k, 1], by_roll[k, 2] = centre[k, 0], centre[k, 1]
            continue
        n1, n2, n11, n12, n22 = n1 / n, n2 / n, n11 / n, n12 / n, n22 / n
        by_roll[k, 0] = math.log(n * cell_p * cell_q) + offset
        by_roll[k, 1], by_roll[k, 2] = centre[k, 0] + n1, centre[k, 1] + n2
        n11, n12, n22 = n11 - n1 * n1, n12 - n1 * n2, n22 - n2 * n2
        by_roll[k, 3], by_roll[k, 4] = math.sqrt(max(n11, 0.0)), math.sqrt(max(n22, 0.0))
        best = max(best, math.log(highest) + offset)
        level = log_prior[k] + by_roll[k, 0]
        if level > scale:
            shrink = math.exp(scale - level) if scale > -1e299 else 0.0
            s0, s1, s2, s3 = s0 * shrink, s1 * shrink, s2 * shrink, s3 * shrink
            m11, m22, m33 = m11 * shrink, m22 * shrink, m33 * shrink
            m12, m13, m23 = m12 * shrink, m13 * shrink, m23 * shrink
            scale = level
        weight = math.exp(level - scale)
        # The mean of left and up, and their covariance; the cells' own extent is part of it.
        p, q, dr = by_roll[k, 1], by_roll[k, 2], rolls[k] - middle
        dl, du = p * cosine - q * sine - l0, -p * sine - q * cosine - u0
        within = (cell_p * cell_p + cell_q * cell_q) / 24.0
        ll = n11 * cosine * cosine - 2.0 * n12 * sine * cosine + n22 * sine * sine + within
        uu = n11 * sine * sine + 2.0 * n12 * sine * cosine + n22 * cosine * cosine + within
        lu = (n22 - n11) * sine * cosine - n12 * (cosine * cosine - sine * sine)
        s0 += weight
        s1 += weight * dl
        s2 += weight * du
        s3 += weight * dr
        m11 += weight * (dl * dl + ll)
        m22 += weight * (du * du + uu)
        m33 += weight * dr * dr
        m12 += weight * (dl * du + lu)
        m13 += weight * dl * dr
        m23 += weight * du * dr
    if s0 <= 0.0:
        out[0] = -1e300
        return out, by_roll
    a1, a2, a3 = s1 / s0, s2 / s0, s3 / s0
    out[0] = math.log(s0) + scale
    out[1], out[2], out[3] = l0 + a1, u0 + a2, middle + a3
    out[4], out[5], out[6] = m11 / s0 - a1 * a1, m22 / s0 - a2 * a2, m33 / s0 - a3 * a3
    out[7], out[8], out[9] = m12 / s0 - a1 * a2, m13 / s0 - a1 * a3, m23 / s0 - a2 * a3
    out[10] = best
    return out, by_roll


@nb.njit(nogil=True, cache=True, error_model="numpy")
def find_corner(
    left: Floats, up: Floats, blooming_m: Floats, softness: Floats, ratio: Floats, hits: NDArray[np.bool_],
    edge_p: float, edge_q: float, slack: float, mean: float, sigma: float, coarse: bool, floor: float,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Return the posterior's moments after three passes of :func:`integrate`, each over a narrower grid.

    Args:
        hits: (N,) which rays surely met the board.
        mean, sigma: radians, of the prior of the roll.
        coarse: for comparing models: two passes.
        floor: the search ends if the log evidence of the first pass is lower.

    Returns:
        Moments as of `integrate`; the last pass's rolls' log evidence (K,), and these rolls (K,). The first moment is
        -1e300 if no board explains the rays, or the first pass ends below ``floor``.
    """
    count = max(_ROLLS, 1 + round(sigma / _ROLL_STEP))
    rolls = _even_rolls(mean - _ROLL_REACH * sigma, mean + _ROLL_REACH * sigma, count)
    centre, half = _grid_over_hits(left, up, hits, edge_p, edge_q, slack, rolls)
    l0, u0 = 0.0, 0.0
    out, by_roll = np.zeros(11), np.zeros((count, 5))
    for number in range(2 if coarse else 3):
        cells = _FINE if number == 2 else _COMPARED if coarse and number == 0 else _COARSE
        prior = np.empty(rolls.size)
        for k in range(rolls.size):
            prior[k] = -0.5 * ((rolls[k] - mean) / sigma) ** 2
        prior += math.log((rolls[1] - rolls[0]) / sigma / math.sqrt(2.0 * math.pi))
        out, by_roll = integrate(
            left - l0, up - u0, blooming_m, softness, ratio, edge_p, edge_q, slack, rolls, prior, centre, half, cells
        )
        if out[0] < max(floor if number == 0 else -math.inf, -1e299):
            out[0] = -1e300
            break
        out[1] += l0
        out[2] += u0
        if number == (1 if coarse else 2):
            break
        reach = 3.0 * max(math.sqrt(max(out[6], 1e-8)), 0.35 * (rolls[1] - rolls[0]))
        low, high = max(out[3] - reach, mean - 3.2 * sigma), min(out[3] + reach, mean + 3.2 * sigma)
        after = _even_rolls(low, high, _ROLLS + 2 if number == 1 else _ROLLS)
        centre, half = _next_grid(rolls, by_roll, half, cells, after, l0, u0, out[1], out[2])
        rolls, l0, u0 = after, out[1], out[2]
    return out, by_roll[:, 0].copy(), rolls


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _grid_over_hits(
    left: Floats, up: Floats, hits: NDArray[np.bool_], edge_p: float, edge_q: float, slack: float, rolls: Floats
) -> tuple[Floats, Floats]:
    """Return middle and half widths (K, 2) of the grid of apexes whose board holds all hits, for each roll."""
    centre, half = np.empty((rolls.size, 2)), np.empty((rolls.size, 2))
    for k in range(rolls.size):
        cosine, sine = math.cos(rolls[k]), math.sin(rolls[k])
        p_high = q_high = -math.inf
        p_low = q_low = math.inf
        for i in range(left.size):
            if hits[i]:
                p, q = cosine * left[i] - sine * up[i], -sine * left[i] - cosine * up[i]
                p_low, p_high, q_low, q_high = min(p_low, p), max(p_high, p), min(q_low, q), max(q_high, q)
        centre[k, 0], centre[k, 1] = 0.5 * (p_high - edge_p + p_low), 0.5 * (q_high - edge_q + q_low)
        half[k, 0] = 0.5 * abs(p_low - p_high + edge_p) + _ASTRAY_M + slack
        half[k, 1] = 0.5 * abs(q_low - q_high + edge_q) + _ASTRAY_M + slack
    return centre, half


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _next_grid(
    rolls: Floats, by_roll: Floats, half: Floats, cells: int, after: Floats,
    l0: float, u0: float, left: float, up: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return middle about (left, up) and half widths (J, 2) of the next pass's grid at its rolls ``after`` (J,).

    Args:
        rolls, by_roll, half, cells: of the pass before, about (l0, u0).
    """
    possible = np.flatnonzero(by_roll[:, 0] > -1e299)
    apex, own = np.empty((2, possible.size)), np.empty((2, possible.size))
    for n in range(possible.size):
        k = possible[n]
        cosine, sine = math.cos(rolls[k]), math.sin(rolls[k])
        p, q = by_roll[k, 1], by_roll[k, 2]
        apex[0, n], apex[1, n] = cosine * p - sine * q + l0, -sine * p - cosine * q + u0
        for axis in range(2):
            own[axis, n] = 3.2 * by_roll[k, 3 + axis] + 2.0 * half[k, axis] / cells
    centre, wide = np.empty((after.size, 2)), np.empty((after.size, 2))
    for axis in range(2):
        centre[:, axis] = np.interp(after, rolls[possible], apex[axis])
        wide[:, axis] = np.interp(after, rolls[possible], own[axis])
    for j in range(after.size):
        cosine, sine = math.cos(after[j]), math.sin(after[j])
        x, y = centre[j, 0] - left, centre[j, 1] - up
        centre[j, 0], centre[j, 1] = cosine * x - sine * y, -sine * x - cosine * y
    return centre, wide


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _even_rolls(low: float, high: float, count: int) -> Floats:
    return low + (high - low) * np.arange(count) / (count - 1)
