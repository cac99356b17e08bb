"""Which way is up: as the ground tells, or as the rig states.

How a board is held is known against gravity, not against the sensor's z. A sensor may be tilted or upside down.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.geometry.ground import STEEPEST_DEG, GroundPlane, ground_plane, is_on

Floats = NDArray[np.float64]

_LEANS_AT_MOST_DEG: Final = 35.0  # of a mount of which nothing is known
# Streets fall by up to 2.5 % across and 6 % along (AASHTO Green Book), together 3.7 degrees. Up to such a tilt the
# ground is no better a sign of gravity than the sensor's z.
_STREETS_DEG: Final = 4.0
_LEAST_SHARE: Final = 0.05
_BELOW_M: Final = 0.5
_MOST_BELOW: Final = 0.05  # of the points; no surface lies below the ground, but mirrors and dust give some
_OTHER_RINGS: Final = 0.2
_LOWEST_M: Final = 0.2  # no sensor is mounted nearer to the ground
# In a hall floor and ceiling are about as large. Sensors are rarely upside down.
_MUCH_MORE: Final = 3.0
_FLIPPED: Final = np.diag([1.0, -1.0, -1.0])


def find_up(xyz: Floats, ring: NDArray[np.int64], stated: Floats | None = None) -> Floats:
    """Direction of up (3,), of unit length, in the LiDAR frame.

    Args:
        xyz: (N, 3) points of some sweeps, metres, LiDAR frame; ring: (N,).
        stated: (3,) as the rig states it; the ground corrects it by up to 15 degrees. Without it the sensor may stand
            upright or upside down, tilted by up to 35 degrees.

    Returns:
        The sensor's z, or the stated direction, if no ground is seen or if the ground's normal is within 4 degrees
        of it.
    """
    if stated is not None:
        turned = _to_level(stated / np.linalg.norm(stated))
        ground = _ground(xyz @ turned.T, ring, STEEPEST_DEG)
        return turned[2] if ground is None else _corrected(ground[0].normal) @ turned
    upright, flipped = _ground(xyz, ring, _LEANS_AT_MOST_DEG), _ground(xyz @ _FLIPPED, ring, _LEANS_AT_MOST_DEG)
    if flipped is not None and (upright is None or flipped[1] > _MUCH_MORE * upright[1]):
        return _corrected(flipped[0].normal) @ _FLIPPED
    return np.array([0.0, 0.0, 1.0]) if upright is None else _corrected(upright[0].normal)


def level_rotation(up: Floats) -> Floats:
    """R_level_lidar (3, 3): z up, x the horizontal direction nearest to the LiDAR's x; exactly 1 if up is its z."""
    return np.eye(3) if up[2] == 1.0 else _to_level(up)


def _to_level(up: Floats) -> Floats:
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = ahead - up * (ahead @ up)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(up, x), up])


def _corrected(normal: Floats) -> Floats:
    within = math.degrees(math.acos(min(float(normal[2]), 1.0))) < _STREETS_DEG
    return np.array([0.0, 0.0, 1.0]) if within else normal


def _ground(xyz: Floats, ring: NDArray[np.int64], steepest_deg: float) -> tuple[GroundPlane, int] | None:
    """The ground below a sensor whose z is about up, and how many points lie on it."""
    plane = ground_plane(xyz, steepest_deg)
    if plane is None or plane.offset < _LOWEST_M:
        return None
    on = is_on(plane, xyz)
    count = int(np.count_nonzero(on))
    below = float(np.mean(plane.height(xyz) < -_BELOW_M))
    # One ring is a cone, and can lie in a plane by itself whatever it meets.
    others = count - int(np.bincount(ring[on]).max())
    sure = count > _LEAST_SHARE * len(xyz) and below < _MOST_BELOW and others > _OTHER_RINGS * count
    return (plane, count) if sure else None
