"""The moment of each point in KITTI's raw recordings, whose clouds carry no times.

The scanner turns counter-clockwise, seen from above, from behind over the right, the front and the left; it triggers
the cameras, and ``timestamps.txt`` states the moment, when it looks ahead (the development kit's readme).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from workers.readers.file_times import kitti_stamps, kitti_times
from workers.readers.recording import LidarFacts, Sweep

KITTI_STARTS: Final = "timestamps_start.txt"
KITTI_ENDS: Final = "timestamps_end.txt"


@dataclass(frozen=True, slots=True)
class KittiSpin:
    """When each turn began and ended.

    Attributes:
        starts_ns, ends_ns: by path of the cloud.
    """

    starts_ns: Mapping[str, int]
    ends_ns: Mapping[str, int]

    @classmethod
    def of(cls, tables: Mapping[str, bytes], paths: Sequence[str], stamps_ns: Mapping[str, int]) -> KittiSpin | None:
        """From KITTI's tables by name; None where there are none for starts and ends, or they do not enclose stamps.

        Raises:
            ReadError: ``timestamps_malformed``, ``timestamps_incomplete``.
        """
        if KITTI_STARTS not in tables or KITTI_ENDS not in tables:
            return None
        starts = kitti_stamps(kitti_times(tables[KITTI_STARTS], KITTI_STARTS), paths)
        ends = kitti_stamps(kitti_times(tables[KITTI_ENDS], KITTI_ENDS), paths)
        enclosed = all(starts[path] <= stamps_ns[path] <= ends[path] <= starts[path] + 10**9 for path in paths)
        return cls(starts, ends) if enclosed else None

    def timed(self, sweep: Sweep, path: str) -> Sweep:
        """The sweep with a time for each point, by its azimuth from behind, between the turn's start and end."""
        start, end = self.starts_ns[path], self.ends_ns[path]
        turn = np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]).astype(np.float64) / (2 * np.pi) + 0.5
        offset = np.rint(start - sweep.stamp_ns + turn * (end - start)).astype(np.int64)
        return replace(sweep, offset_ns=offset, time_source="derived_from_azimuth")

    def facts(self, facts: LidarFacts, where: str) -> LidarFacts:
        """The LiDAR's facts with these times."""
        lengths = [self.ends_ns[path] - start for path, start in self.starts_ns.items()]
        note = (
            f"{where}: times of points were derived from the azimuth between {KITTI_STARTS} and {KITTI_ENDS}; a "
            "stamp is the moment at which the scanner looks ahead."
        )
        return replace(
            facts,
            sweep_ns=max(1, int(np.median(lengths))),
            time_source="derived_from_azimuth",
            notes=(*facts.notes, note),
        )
