"""The ground that a sweep shows: one plane below the sensor."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Roads drain by 2-4 % across (AASHTO Green Book), and a plane holds over tens of metres.
_THICK_M: Final = 0.1
_FARTHEST_M: Final = 40.0
_NEAREST_M: Final = 2.0
STEEPEST_DEG: Final = 15.0  # a LiDAR on a vehicle leans by less, and so do roads
_DRAWS: Final = 200
_SAMPLED: Final = 3000
_REFITS: Final = 3
_FEWEST: Final = 100


class GroundPlane(NamedTuple):
    """Points x with normal . x + offset = 0, metres, LiDAR frame; the normal is of unit length and points up."""

    normal: Floats
    offset: float

    def height(self, points: Floats) -> Floats:
        """(N,) metres above the plane."""
        return points @ self.normal + self.offset


def ground_plane(points: Floats, steepest_deg: float = STEEPEST_DEG) -> GroundPlane | None:
    """The plane that most points below the sensor lie on (RANSAC, then least squares); None where there is none.

    Args:
        points: (N, 3), metres, LiDAR frame with z up. The draws are the same at every call.
        steepest_deg: between the plane's normal and z.
    """
    steepest = float(np.cos(np.radians(steepest_deg)))
    flat = np.hypot(points[:, 0], points[:, 1])
    low = points[(points[:, 2] < 0.0) & (flat > _NEAREST_M) & (flat < _FARTHEST_M)]
    if len(low) < _FEWEST:
        return None
    random = np.random.default_rng(0)
    few = low[:: max(1, len(low) // _SAMPLED)]
    three = few[random.integers(0, len(few), (_DRAWS, 3))]
    normals = np.cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-6] / length[length > 1e-6, None]
    normals *= np.sign(normals[:, 2])[:, None]
    offsets = -np.einsum("ij,ij->i", normals, three[length > 1e-6, 0])
    level = normals[:, 2] > steepest
    if not level.any():
        return None
    normals, offsets = normals[level], offsets[level]
    heights = normals @ few.T
    heights += offsets[:, None]
    inside = np.count_nonzero(np.abs(heights, out=heights) < _THICK_M, axis=1)
    plane = GroundPlane(normals[inside.argmax()], float(offsets[inside.argmax()]))
    for _ in range(_REFITS):
        on = low[np.abs(plane.height(low)) < _THICK_M]
        if len(on) < _FEWEST:
            return None
        middle = on.mean(axis=0)
        normal = np.linalg.svd(on - middle, full_matrices=False)[2][2]
        normal = normal * np.sign(normal[2])
        plane = GroundPlane(normal, float(-middle @ normal))
    return plane if plane.normal[2] > steepest else None


def is_on(plane: GroundPlane, points: Floats) -> NDArray[np.bool_]:
    """Return which points lie on the ground, at most 40 m away."""
    near = np.hypot(points[:, 0], points[:, 1]) < _FARTHEST_M
    return near & (np.abs(plane.height(points)) < _THICK_M)
