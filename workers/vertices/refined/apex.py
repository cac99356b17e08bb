"""From a board in its plane to what is stated of it: the apex in the LiDAR's own axes, and the rays against it."""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.vertices.refined.corner import step

Floats = NDArray[np.float64]


@nb.njit(nogil=True, cache=True, error_model="numpy")
def to_angles(R_window_lidar: Floats, w: Floats, spread: Floats, at: Floats) -> tuple[Floats, Floats, float, Floats]:
    """A place in a plane, in the LiDAR frame.

    Args:
        w: (3,) the plane, in the window's frame; spread: (3, 3) its covariance.
        at: (2,) metres to the left and up.

    Returns:
        xyz (3,); (3, 2) derivatives of azimuth, elevation and range by ``at``; the variance of the range that the
        plane leaves open; (3,) what azimuth, elevation and range change by where the place rises by a radian of its
        distance.
    """
    norm = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    n = w / norm
    flat = math.hypot(n[0], n[1])
    # e_left = z x n, e_up = n x e_left
    axes = np.zeros((3, 3))
    axes[0, 0], axes[1, 0] = -n[1] / flat, n[0] / flat
    axes[0, 1], axes[1, 1], axes[2, 1] = -n[2] * axes[1, 0], n[2] * axes[0, 0], flat
    apex = n / norm + at[0] * axes[:, 0] + at[1] * axes[:, 1]
    x, y, z = apex
    reach = math.sqrt(x * x + y * y + z * z)
    flat = math.hypot(x, y)
    axes[:, 2] = np.array([-x * z / flat, -y * z / flat, flat])
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += apex[i] * spread[i, j] * apex[j]
    variance *= reach * reach
    turned = np.zeros((3, 3))
    xyz = np.zeros(3)
    for i in range(3):
        for j in range(3):
            xyz[i] += R_window_lidar[j, i] * apex[j]
            for k in range(3):
                turned[i, k] += R_window_lidar[j, i] * axes[j, k]
    x, y, z = xyz
    flat = math.hypot(x, y)
    moved = np.empty((3, 3))
    for k in range(3):
        a, b, c = turned[:, k]
        moved[0, k] = (x * b - y * a) / flat**2
        moved[1, k] = (flat * c - (x * a + y * b) * z / flat) / reach**2
        moved[2, k] = (x * a + y * b + z * c) / reach
    return xyz, moved[:, :2].copy(), variance, moved[:, 2].copy()


@nb.njit(nogil=True, cache=True, error_model="numpy")
def covered(
    left: Floats, up: Floats, grow: Floats, reach: Floats, soft: float, slack: float,
    edge_p: float, edge_q: float, corner: Floats,
) -> Floats:  # fmt: skip
    """(N,) probability that rays which meet the plane there lie on the board in the middle of its posterior.

    Args:
        left, up: (N,) metres; grow: (N,) metres by which the edges seem to lie farther out.
        reach: (N,) metres; soft: radians, half width of the step at an edge.
        slack: metres, half width of what is not known of the edges' lengths edge_p and edge_q.
        corner: moments as of `corner.integrate`.
    """
    cosine, sine = math.cos(corner[3]), math.sin(corner[3])
    on_board = np.empty(left.size)
    for i in range(left.size):
        x, y = left[i] - corner[1], up[i] - corner[2]
        p, q = cosine * x - sine * y, -sine * x - cosine * y
        near = reach[i] * soft
        far = math.hypot(near, slack)
        on_board[i] = step((p + grow[i]) / near) * step((edge_p + grow[i] - p) / far)
        on_board[i] *= step((q + grow[i]) / near) * step((edge_q + grow[i] - q) / far)
    return on_board
