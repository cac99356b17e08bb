"""The posterior of a board's apex and roll in its plane, from rays that meet the board and rays that miss it.

In the plane, with the roll fixed, a point's distances to the four edges are differences of coordinates along the two
edges, so the probability that a ray lies on the board is a product g(p) h(q), and the likelihood of a ray over a grid
of apexes is 1 + (lambda - 1) g(p) h(q): no more than one multiplication and addition per cell and ray. So the
posterior is summed over a grid, instead of sampled.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# A ray leaves 0.002 of a cell's likelihood at least, so that sixteen leave 1e-43.
_RESCALED_AFTER, _TINY = 16, 1e-100


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _step(x: float) -> float:
    """A smooth step from 0 at -1 to 1 at 1."""
    t = min(max(0.5 * x + 0.5, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def integrate(
    left: Floats, up: Floats, grow: Floats, soft: Floats, ratio: Floats,
    edge_p: float, edge_q: float, slack: float,
    rolls: Floats, log_prior: Floats, centre: Floats, lean: Floats, half: Floats, cells: int,
) -> Floats:  # fmt: skip
    """Moments of the posterior over (apex left, apex up, roll).

    Args:
        left, up: (N,) metres, where each ray meets the plane.
        grow: (N,) metres by which the edges seem to lie farther out at the ray.
        soft: (N,) metres, half width of the step at an edge.
        ratio: (N,) likelihood of what the ray met if the board is there over that if it is not.
        edge_p, edge_q: metres, edges to the lower left and to the lower right.
        slack: metres, half width of what is not known of the edges' lengths.
        rolls: (K,) radians, even; log_prior: (K,).
        centre: (2,) p and q of the grid's middle at the middle roll; lean: (2,) its change per radian; half: (2,)
            half widths of the grid, metres.
        cells: grid cells along either side.

    Returns:
        (12,) log evidence, mean left, up, roll, covariance (ll, uu, rr, lu, lr, ur), best log likelihood, share of
        the weight in the outermost cells.
    """
    rays = left.size
    cell_p, cell_q = 2.0 * half[0] / cells, 2.0 * half[1] / cells
    grid = np.empty((cells, cells))
    on_p, on_q = np.empty(cells), np.empty(cells)
    s0 = s1 = s2 = s3 = 0.0
    m11 = m22 = m33 = m12 = m13 = m23 = 0.0
    best, rim = -1e300, 0.0
    middle = 0.5 * (rolls[0] + rolls[-1])
    # Moments about the middle of the grid.
    cm, sm = math.cos(middle), math.sin(middle)
    l0, u0 = centre[0] * cm - centre[1] * sm, -centre[0] * sm - centre[1] * cm
    scale = -1e300
    for k in range(rolls.size):
        cosine, sine = math.cos(rolls[k]), math.sin(rolls[k])
        p0 = centre[0] + lean[0] * (rolls[k] - middle) - half[0] + 0.5 * cell_p
        q0 = centre[1] + lean[1] * (rolls[k] - middle) - half[1] + 0.5 * cell_q
        grid[:] = 1.0
        offset = 0.0
        for i in range(rays):
            p = left[i] * cosine - up[i] * sine
            q = -left[i] * sine - up[i] * cosine
            low_p, low_q = 1.0 / max(soft[i], 0.75 * cell_p), 1.0 / max(soft[i], 0.75 * cell_q)
            far_p = 1.0 / max(math.sqrt(soft[i] * soft[i] + slack * slack), 0.75 * cell_p)
            far_q = 1.0 / max(math.sqrt(soft[i] * soft[i] + slack * slack), 0.75 * cell_q)
            top = max(ratio[i], 1.0)
            base, gain = 1.0 / top, (ratio[i] - 1.0) / top
            some_p = 0.0
            for a in range(cells):
                x = p - (p0 + a * cell_p)
                on_p[a] = gain * _step((x + grow[i]) * low_p) * _step((edge_p + grow[i] - x) * far_p)
                some_p += abs(on_p[a])
            if some_p == 0.0:
                if base < 1.0:
                    offset += math.log(base)
                continue
            for b in range(cells):
                x = q - (q0 + b * cell_q)
                on_q[b] = _step((x + grow[i]) * low_q) * _step((edge_q + grow[i] - x) * far_q)
            for a in range(cells):
                g = on_p[a]
                if g == 0.0:
                    for b in range(cells):
                        grid[a, b] *= base
                else:
                    for b in range(cells):
                        grid[a, b] *= base + g * on_q[b]
            if i % _RESCALED_AFTER == _RESCALED_AFTER - 1:
                # Hundreds of rays that contradict even the best cell would leave nothing but zeros.
                most = np.max(grid)
                if 0.0 < most < _TINY:
                    grid *= 1.0 / most
                    offset += math.log(most)
        highest = 0.0
        for a in range(cells):
            for b in range(cells):
                highest = max(highest, grid[a, b])
        if highest <= 0.0:
            continue
        best = max(best, math.log(highest) + offset)
        level = log_prior[k] + offset
        top_level = level + math.log(highest)
        if top_level > scale:
            shrink = math.exp(scale - top_level) if scale > -1e299 else 0.0
            s0 *= shrink
            s1 *= shrink
            s2 *= shrink
            s3 *= shrink
            m11 *= shrink
            m22 *= shrink
            m33 *= shrink
            m12 *= shrink
            m13 *= shrink
            m23 *= shrink
            rim *= shrink
            scale = top_level
        factor = math.exp(level - scale)
        if factor == 0.0:
            continue
        dr = rolls[k] - middle
        for a in range(cells):
            p = p0 + a * cell_p
            for b in range(cells):
                weight = grid[a, b] * factor
                q = q0 + b * cell_q
                dl, du = p * cosine - q * sine - l0, -p * sine - q * cosine - u0
                s0 += weight
                s1 += weight * dl
                s2 += weight * du
                s3 += weight * dr
                m11 += weight * dl * dl
                m22 += weight * du * du
                m33 += weight * dr * dr
                m12 += weight * dl * du
                m13 += weight * dl * dr
                m23 += weight * du * dr
                if a == 0 or b == 0 or a == cells - 1 or b == cells - 1:
                    rim += weight
    out = np.zeros(12)
    if s0 <= 0.0:
        out[0] = -1e300
        return out
    a1, a2, a3 = s1 / s0, s2 / s0, s3 / s0
    out[0] = math.log(s0 * cell_p * cell_q) + scale
    out[1], out[2], out[3] = l0 + a1, u0 + a2, middle + a3
    # The cells' own extent is part of the variance.
    within = (cell_p * cell_p + cell_q * cell_q) / 24.0
    out[4], out[5], out[6] = m11 / s0 - a1 * a1 + within, m22 / s0 - a2 * a2 + within, m33 / s0 - a3 * a3
    out[7], out[8], out[9] = m12 / s0 - a1 * a2, m13 / s0 - a1 * a3, m23 / s0 - a2 * a3
    out[10], out[11] = best, rim / s0
    return out
