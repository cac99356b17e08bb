"""The motion of a vehicle while a sweep is taken, from two sweeps alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
import small_gicp  # pyright: ignore[reportMissingTypeStubs]
from numpy.typing import NDArray

from apexcal.geometry.rotations import vector_from_rotation
from workers.readers.normalised.sensor_files import SweepFile
from workers.readers.recording import Sweep

Floats = NDArray[np.float64]
# small-gicp publishes no types.
_registration: Any = small_gicp

# Sweeps of the supported sensors follow each other in 0.05 to 0.2 s.
_LATEST_S: Final = 0.35
# Points are thinned to this grid; kiss-icp and small-gicp take 0.25 to 1 m outdoors.
_GRID_M: Final = 0.4
# Distances of points that may belong together, from the first round to the last: 3.6 m are 130 km/h in 0.1 s.
_REACHES_M: Final = (4.0, 2.0, 1.0, 0.5)
# Least share of the thinned points that have a partner; sweeps of unrelated places have less than half.
_TOGETHER: Final = 0.6
_FEWEST: Final = 200
# A standing LiDAR of 1 to 3 cm of noise registers with up to 0.02 m/s and 0.2 degrees/s.
_STILL_M_S: Final = 0.15
_STILL_DEG_S: Final = 0.5


@dataclass(frozen=True, eq=False)
class Motion:
    """Constant velocity of the LiDAR.

    Attributes:
        angular: (3,) rad/s; linear: (3,) m/s; both in the LiDAR frame.
        moment_ns: the moment to which points are moved, after the sweep's stamp.
    """

    angular: Floats = field(default_factory=lambda: np.zeros(3))
    linear: Floats = field(default_factory=lambda: np.zeros(3))
    moment_ns: int = 0

    def applied(self, points: Floats, offset_ns: NDArray[np.int64]) -> Floats:
        """Move points (N, 3), metres, measured ``offset_ns`` (N,) after the stamp, into the frame of the moment.

        Turns are taken to the second order: 1 degree within a sweep leaves less than 1e-6.
        """
        if not self.angular.any() and not self.linear.any():
            return points
        seconds = (1e-9 * (offset_ns - self.moment_ns))[:, None]
        turn = self.angular * seconds
        first = np.cross(turn, points)
        return points + first + 0.5 * np.cross(turn, first) + self.linear * seconds

    def moved(self, sweep: Sweep) -> Sweep:
        """Return the sweep with its points moved to the moment."""
        xyz = self.applied(sweep.xyz.astype(np.float64), sweep.offset_ns)
        return replace(sweep, xyz=xyz.astype(np.float32))

    def at(self, moment_ns: int) -> Motion:
        """Return the motion that moves points to another moment."""
        return replace(self, moment_ns=moment_ns)

    @property
    def is_moving(self) -> bool:
        """Return whether points move more within a sweep than their own and the registration's noise explains."""
        return self.speed_m_s > _STILL_M_S or self.turn_deg_s > _STILL_DEG_S

    @property
    def speed_m_s(self) -> float:
        """Return how fast the LiDAR moves."""
        return float(np.linalg.norm(self.linear))

    @property
    def turn_deg_s(self) -> float:
        """Return how fast the LiDAR turns."""
        return float(np.degrees(np.linalg.norm(self.angular)))


STANDING: Final = Motion()


def motion_between(first: Sweep, second: Sweep) -> Motion | None:
    """Return the motion that lays two sweeps, each moved to its stamp, on one another; None if none does.

    Registration is small-gicp's (Koide 2024), generalized ICP (Segal, Haehnel and Thrun 2009).
    """
    seconds = 1e-9 * (second.stamp_ns - first.stamp_ns)
    if not 0.0 < abs(seconds) < _LATEST_S or min(len(first.xyz), len(second.xyz)) < _FEWEST:
        return None
    motion, pose, share = Motion(), np.eye(4), 0.0
    for reach_m in _REACHES_M:
        target, source = (motion.applied(sweep.xyz.astype(np.float64), sweep.offset_ns) for sweep in (first, second))
        fit: Any = _registration.align(
            target, source, init_T_target_source=pose, registration_type="GICP", downsampling_resolution=_GRID_M,
            max_correspondence_distance=reach_m, num_threads=1, max_iterations=30,
        )  # fmt: skip
        pose = np.asarray(fit.T_target_source, np.float64)
        motion = Motion(vector_from_rotation(pose[:3, :3]) / seconds, pose[:3, 3] / seconds)
        share = fit.num_inliers / len(_registration.voxelgrid_sampling(source, _GRID_M).points())
    return motion if share >= _TOGETHER else None


class DriveMotion(NamedTuple):
    """The motion at the sweep of each frame.

    Attributes:
        sweeps: number of the sweep of each frame.
        motions: motion of that sweep to the frame's moment; None if it is unknown: the frame is left out.
        is_told: the motions of half of the frames or more are known; otherwise points stay where they were measured.
    """

    sweeps: list[int]
    motions: list[Motion | None]
    is_told: bool

    @classmethod
    def of(cls, lidar: SweepFile, stamps_ns: Sequence[int], behind_ns: int) -> DriveMotion:
        """Make the motion at the frames' stamps.

        ``behind_ns``: time from a sweep's stamp until the LiDAR measures what the frame shows.
        """
        sweeps = [lidar.nearest(stamp_ns - behind_ns) for stamp_ns in stamps_ns]
        by_sweep: dict[int, Motion | None] = {}
        for number in set(sweeps) if len(lidar) > 1 else ():
            other = number + 1 if number + 1 < len(lidar) else number - 1
            by_sweep[number] = motion_between(lidar.sweep(number), lidar.sweep(other))
        is_told = 2 * sum(by_sweep.get(number) is not None for number in sweeps) >= len(sweeps) > 0
        motions: list[Motion | None] = []
        for number, stamp_ns in zip(sweeps, stamps_ns, strict=True):
            moment_ns, motion = int(stamp_ns - lidar.stamps_ns[number]), by_sweep.get(number)
            if not is_told:
                motions.append(STANDING)
            elif motion is None or (motion.is_moving and abs(moment_ns) > 1e9 * _LATEST_S):
                motions.append(None)
            else:
                motions.append(motion.at(moment_ns) if motion.is_moving else STANDING)
        return cls(sweeps, motions, is_told)

    @property
    def sentence(self) -> str:
        """Say how the vehicle moves, and what a clock offset does at that speed."""
        moving = [motion for motion in self.motions if motion is not None and motion.is_moving]
        if not self.is_told:
            return "The vehicle's motion could not be told from the LiDAR: points stay where they were measured."
        if not moving:
            return "The vehicle stands."
        speed, turn = (max(getattr(motion, name) for motion in moving) for name in ("speed_m_s", "turn_deg_s"))
        # What stands 10 m away and 3 m aside passes the camera at this angle a second.
        passing_deg_s = np.degrees(speed * 3.0 / (10.0**2 + 3.0**2))
        return (
            f"The vehicle moves at up to {3.6 * speed:.0f} km/h and turns by up to {turn:.1f} degrees/s: points were "
            f"moved to the frames' moments. Clocks 10 ms apart look like a turn of up to {0.01 * turn:.2f} degrees, "
            f"{0.01 * passing_deg_s:.2f} more for objects 10 m away and 3 m aside."
        )
