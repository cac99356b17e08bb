"""The board's outline in its plane: the probability that a ray lies between the edges, for posterior and checks."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
NOTHING, PART, ALL = 0, 1, 2


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _smoothstep(x: float) -> float:
    """Return a smooth step: 0 at -1, 1 at 1."""
    t = min(max(0.5 * x + 0.5, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@nb.njit(nogil=True, cache=True, error_model="numpy", fastmath=True, inline="always")
def edge_profile(
    x: float, cell: float, blooming_m: float, softness: float, far: float, edge: float, on: Floats
) -> int:
    """Fill ``on`` (C,) with the probability that a ray lies between two edges, or return NOTHING or ALL if constant.

    The ray lies ``x`` metres from the near edge in the first cell, and a cell less in each further one.
    """
    low, high = 1.0 / max(softness, 0.75 * cell), 1.0 / max(far, 0.75 * cell)
    least = x - (on.size - 1) * cell
    if (x + blooming_m) * low <= -1.0 or (edge + blooming_m - least) * high <= -1.0:
        return NOTHING
    if (least + blooming_m) * low >= 1.0 and (edge + blooming_m - x) * high >= 1.0:
        return ALL
    for a in range(on.size):
        at = x - a * cell
        on[a] = _smoothstep((at + blooming_m) * low) * _smoothstep((edge + blooming_m - at) * high)
    return PART


@nb.njit(nogil=True, cache=True, error_model="numpy")
def on_board_probability(
    left: Floats, up: Floats, blooming_m: Floats, reach: Floats, softness: float, slack: float,
    edge_p: float, edge_q: float, moments: Floats,
) -> Floats:  # fmt: skip
    """Return (N,) the probability that each ray lies on the board in the middle of its posterior.

    Args:
        left, up: (N,) metres, where the rays meet the plane; blooming_m: (N,) metres by which edges appear shifted
            outward.
        reach: (N,) metres; softness: radians, half width of the step at an edge.
        slack: metres, half width of the interval in which the edges' lengths ``edge_p`` and ``edge_q`` (m) lie.
        moments: as of `posterior.integrate`.
    """
    cosine, sine = math.cos(moments[3]), math.sin(moments[3])
    on_board = np.empty(left.size)
    for i in range(left.size):
        x, y = left[i] - moments[1], up[i] - moments[2]
        p, q = cosine * x - sine * y, -sine * x - cosine * y
        near = reach[i] * softness
        far = math.hypot(near, slack)
        on_board[i] = _smoothstep((p + blooming_m[i]) / near) * _smoothstep((edge_p + blooming_m[i] - p) / far)
        on_board[i] *= _smoothstep((q + blooming_m[i]) / near) * _smoothstep((edge_q + blooming_m[i] - q) / far)
    return on_board
