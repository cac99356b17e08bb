"""Points of a sweep that stand together, seen from above."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_CELL_M = 0.4


def clusters(xyz: NDArray[np.float32]) -> list[tuple[float, float]]:
    """Azimuth of the middle and half the width of each group of points, radians.

    Args:
        xyz: (N, 3) metres; points in neighbouring cells of 0.4 m belong together.
    """
    if not len(xyz):
        return []
    cell = np.unique(np.floor(xyz[:, :2].astype(np.float64) / _CELL_M).astype(np.int64), axis=0)
    near = np.abs(cell[:, None, :] - cell[None, :, :]).max(axis=2) <= 1
    label = np.arange(len(cell))
    while True:
        lowest = np.where(near, label[None, :], len(cell)).min(axis=1)
        if (lowest == label).all():
            break
        label = lowest
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    found: list[tuple[float, float]] = []
    for name in np.unique(label):
        members = (cell[label == name][:, None, :] + corners[None, :, :]).reshape(-1, 2) * _CELL_M
        x, y = members.mean(axis=0).tolist()
        across = members[:, 1] * x - members[:, 0] * y
        half = float(np.abs(np.arctan2(across, members @ np.array([x, y]))).max())
        found.append((math.atan2(y, x), half))
    return found
