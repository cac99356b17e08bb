"""A simulated walk, and pairs of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.simulation.camera import SimulatedCamera
from workers.simulation.rig import START_NS, SimulatedRig
from workers.simulation.walker import Poses

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

CORNERS: Final = 4  # of the board: the apex, those beside it, and the one below


@dataclass(frozen=True, eq=False)
class Walked:
    """A simulated walk."""

    rig: SimulatedRig

    def poses(self, times_ns: Integers) -> Poses:
        """Board and people at moments of the LiDAR's clock."""
        return self.rig.walk.poses((times_ns - START_NS).astype(np.float64) * 1e-9)


@dataclass(frozen=True, eq=False)
class Paired:
    """N vertices moved to the moments of their frames.

    ``xyz`` metres, ``sigmas`` (N, 3) of azimuth, elevation (rad) and range (m), ``taken_ns`` when the frames were
    truly taken by the LiDAR's clock, ``stamps_ns`` of the vertices, ``sweeps`` and ``frames`` their numbers.
    ``corner``: which of the board's is marked, 0 the apex. ``pose``: pairs of one number share a pose's errors.
    """

    walked: Walked
    camera: SimulatedCamera
    nominal: dict[str, object]
    xyz: Floats
    sigmas: Floats
    taken_ns: Integers
    stamps_ns: Integers
    sweeps: Integers
    frames: Integers
    corner: Integers
    pose: Integers

    @property
    def is_still(self) -> bool:
        """Whether the board stood still in each pose, and all its corners are marked."""
        return bool(np.any(self.corner))

    def places(self, times_ns: Integers) -> Floats:
        """(N, 3) where the marked corners truly are at these moments, metres, LiDAR frame."""
        poses = self.walked.poses(times_ns)
        left, right = (
            edge * way for edge, way in zip(poses.board_m, (poses.edge_left, poses.edge_right), strict=True)
        )
        beside = np.stack([np.zeros_like(left), left, right, left + right])
        return poses.apex + beside[self.corner, np.arange(len(self.corner))]
