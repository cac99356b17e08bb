"""Marks that are wrong the way people and clocks are wrong, not anywhere in the image."""

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from benchmarks.accuracy.rigs import Rig
from workers.geometry.projection import project
from workers.simulation.walker import BOARD_EDGES_M

Floats = NDArray[np.float64]
_UP = np.array([0.0, -1.0, 0.0])  # of the optical frame
_LANE_M = 1.5


def mount_of(truth: Floats) -> tuple[Floats, Floats]:
    """R (3, 3) and t (3,) of T_camera_lidar."""
    return rotation_from_vector(truth[:3]) @ FORWARD_LIDAR_TO_OPTICAL, truth[3:6]


def camera_points(rig: Rig) -> Floats:
    """The rig's vertices (N, 3) in the camera's optical frame, metres."""
    R, t = mount_of(rig.truth)
    return rig.points @ R.T + t


def in_walking_order(rig: Rig) -> NDArray[np.int64]:
    """Indices of the pairs as a walker meets them who goes up and down the field in lanes."""
    x, _, z = camera_points(rig).T
    lane = np.floor(x / _LANE_M)
    return np.lexsort((np.where(lane % 2 == 0, z, -z), lane))


def other_corner(rig: Rig, share: float, rng: np.random.Generator) -> Floats:
    """Marks (N, 2) of which a share are those of the board's right or left corner, the same one throughout.

    The board is upright, 2 x 3 feet, turned by 45 degrees, and faces the camera to 20 degrees. The corners that
    lie in the image can be marked; where they are fewer than the share, ValueError.
    """
    corners = _corners(rig, rng)
    size = np.array(rig.image_size) - 1.0
    can = np.flatnonzero(((corners >= 0.0) & (corners <= size)).all(axis=1))
    wanted = round(share * len(rig.marks))
    if len(can) < wanted:
        raise ValueError(f"{len(can)} corners in the image, {wanted} to be marked")
    bad = rng.choice(can, wanted, replace=False)
    marks = rig.marks.copy()
    # The person's hand is as steady there as it is on the apex.
    marks[bad] = corners[bad] + rng.normal(size=(wanted, 2))
    return marks


def swapped_neighbours(rig: Rig, share: float, rng: np.random.Generator) -> Floats:
    """Marks (N, 2) of which a share are exchanged with those of the frame next to theirs, two by two."""
    order = in_walking_order(rig)
    twos = order[: len(order) // 2 * 2].reshape(-1, 2)
    bad = twos[rng.choice(len(twos), round(share * len(order) / 2.0), replace=False)]
    marks = rig.marks.copy()
    marks[bad] = rig.marks[bad[:, ::-1]]
    return marks


def slipped_run(rig: Rig, share: float, rng: np.random.Generator) -> Floats:
    """Marks (N, 2) with one run of frames whose marks are all those of the next frame, as after a lost frame."""
    order = in_walking_order(rig)
    length = round(share * len(order))
    begin = int(rng.integers(0, len(order) - length))
    marks = rig.marks.copy()
    marks[order[begin : begin + length]] = rig.marks[order[begin + 1 : begin + length + 1]]
    return marks


def _corners(rig: Rig, rng: np.random.Generator) -> Floats:
    # Pixels (N, 2) of one other corner: along an edge that goes down at 45 degrees from the apex; not a number where
    # the camera does not see it.
    apex = camera_points(rig)
    level = apex * np.array([1.0, 0.0, 1.0])
    away = level / np.linalg.norm(level, axis=1, keepdims=True)
    yaw = np.radians(rng.uniform(-20.0, 20.0, (len(apex), 1)))
    side = np.cos(yaw) * np.cross(away, _UP) + np.sin(yaw) * away
    edge = rng.choice(BOARD_EDGES_M) * np.sqrt(0.5) * (rng.choice((-1.0, 1.0)) * side - _UP)
    return project(rig.model, rig.truth[6:], apex + edge)[0]
