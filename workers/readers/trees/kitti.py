"""The moment of each point in recordings of KITTI's raw layout, whose clouds carry no times.

KITTI's scanner turns counter-clockwise, seen from above. It triggers the cameras when it looks ahead, and
``timestamps.txt`` states that moment (the development kit's readme). Clouds list a ring's points in the order in
which they were measured; that order also shows a scanner that turns the other way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.ring_runs import direction_of
from workers.readers.recording import LidarFacts, Sweep
from workers.readers.trees.file_times import kitti_stamps, kitti_times

KITTI_STARTS: Final = "timestamps_start.txt"
KITTI_ENDS: Final = "timestamps_end.txt"


@dataclass(frozen=True, slots=True)
class KittiSpin:
    """How the scanner turned.

    Attributes:
        starts_ns, ends_ns: start and end of each turn, by path of the cloud.
        turn_ns: duration of a whole turn.
        direction: +1 counter-clockwise, -1 clockwise.
    """

    starts_ns: Mapping[str, int]
    ends_ns: Mapping[str, int]
    turn_ns: int
    direction: int

    @classmethod
    def of(
        cls, tables: Mapping[str, bytes], stamps_ns: Mapping[str, int], turn_ns: int | None, xyz: NDArray[np.float32]
    ) -> KittiSpin | None:
        """The spin that KITTI's tables state; None without tables of starts and ends, or if these miss a stamp.

        Args:
            tables: contents of the tables, by file name.
            stamps_ns: stamps, by path of the cloud. Each must lie between its turn's start and end.
            turn_ns: duration of a turn if it is known; None: from starts and ends.
            xyz: (N, 3) points of one cloud in the order of its file.

        Raises:
            ReadError: ``timestamps_malformed``, ``timestamps_incomplete``.
        """
        if KITTI_STARTS not in tables or KITTI_ENDS not in tables:
            return None
        paths = list(stamps_ns)
        starts = kitti_stamps(kitti_times(tables[KITTI_STARTS], KITTI_STARTS), paths)
        ends = kitti_stamps(kitti_times(tables[KITTI_ENDS], KITTI_ENDS), paths)
        if not all(starts[path] <= stamps_ns[path] <= ends[path] <= starts[path] + 10**9 for path in paths):
            return None
        lasting = max(1, int(np.median([ends[path] - starts[path] for path in paths])))
        # A scanner set to a sector ends its sweep before its turn ends. No turn outlasts the time to the next sweep.
        whole = turn_ns if turn_ns is not None and lasting <= turn_ns <= 10**9 else lasting
        return cls(starts, ends, whole, direction_of(xyz) or 1)

    def timed(self, sweep: Sweep, path: str) -> Sweep:
        """The sweep with a time for each point, from its azimuth (0 ahead), clipped to the turn's start and end."""
        azimuth = np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]).astype(np.float64)
        offset = np.rint(self.direction * azimuth / (2 * np.pi) * self.turn_ns).astype(np.int64)
        offset = np.clip(offset, self.starts_ns[path] - sweep.stamp_ns, self.ends_ns[path] - sweep.stamp_ns)
        return replace(sweep, offset_ns=offset, time_source="derived_from_azimuth")

    def facts(self, facts: LidarFacts, where: str) -> LidarFacts:
        """The LiDAR's facts, with the source of these times and a note."""
        way = "counter-clockwise" if self.direction > 0 else "clockwise"
        note = (
            f"{where}: times of points were derived from the azimuth, {way} in {self.turn_ns / 1e6:.1f} ms, within "
            f"{KITTI_STARTS} and {KITTI_ENDS}; a stamp is the moment at which the scanner looks ahead."
        )
        return replace(facts, sweep_ns=self.turn_ns, time_source="derived_from_azimuth", notes=(*facts.notes, note))
