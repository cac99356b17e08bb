"""Shapes on the ground: clusters of points seen from above, and the convex area around them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SIDES: Final = 20  # of the areas that are suggested


def clusters(xy: Floats, cell_m: float) -> NDArray[np.int64]:
    """(N,) the cluster of each point (N, 2), numbered from 0: cells of ``cell_m`` that touch, corners included."""
    cells, of_point = np.unique(np.floor(xy / cell_m).astype(np.int64), axis=0, return_inverse=True)
    number = {(int(x), int(y)): i for i, (x, y) in enumerate(cells)}
    cluster = np.full(len(cells), -1, np.int64)
    found = 0
    for first in range(len(cells)):
        if cluster[first] >= 0:
            continue
        cluster[first] = found
        waiting = [first]
        while waiting:
            x, y = cells[waiting.pop()].tolist()
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    other = number.get((x + dx, y + dy), -1)
                    if other >= 0 and cluster[other] < 0:
                        cluster[other] = found
                        waiting.append(other)
        found += 1
    return cluster[of_point.reshape(-1)]


def area_around(xy: Floats, margin_m: float) -> Floats:
    """Corners (SIDES, 2), counter-clockwise, of a convex polygon that holds points (N, 2) and ``margin_m`` around.

    Its sides have fixed directions; each lies the margin outside of the farthest point in its direction.
    """
    angle = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    reach = (xy @ normal.T).max(axis=0) + margin_m
    following = np.roll(normal, -1, axis=0)
    # Each corner lies on two sides: normal . corner = reach.
    corners = np.linalg.solve(
        np.stack([normal, following], axis=1), np.column_stack([reach, np.roll(reach, -1)])[..., None]
    )
    return corners[..., 0]


def area_m2(corners: Floats) -> float:
    """Area of a simple polygon (K, 2)."""
    x, y = corners.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
