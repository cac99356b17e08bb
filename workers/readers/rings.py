"""Rings numbered by elevation, 0 the lowest, whatever a sensor's own laser ids are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Line counts of the sensors on the market: a file whose highest lasers see only sky still counts from the right end.
_LINE_COUNTS: Final = (1, 4, 8, 16, 20, 32, 40, 64, 80, 96, 120, 128, 192, 256)
_ENOUGH_POINTS: Final = 20
_CLEAR_STEP_DEG: Final = 0.1


@dataclass(frozen=True, slots=True)
class RingOrder:
    """The file's ring ids to numbers by elevation.

    Attributes:
        table: (largest id + 1,) int32, number of each id, -1 for an id that is not known.
        count: number of rings; numbers are 0 to count - 1.
        note: a sentence where the numbers differ from the file's, else empty.
    """

    table: NDArray[np.int32]
    count: int
    note: str

    def number(self, ids: NDArray[np.generic]) -> NDArray[np.int32]:
        """(N,) int32 numbers of (N,) ids, -1 where an id is not known."""
        index = ids.astype(np.int64)
        known = (index >= 0) & (index < len(self.table))
        if known.all():
            return self.table[index]
        return np.where(known, self.table[np.where(known, index, 0)], np.int32(-1))


def learn_rings(clouds: Sequence[tuple[NDArray[np.float32], NDArray[np.int64]]]) -> RingOrder:
    """The order of the rings from sample clouds.

    Ids that already ascend with elevation are kept, so that an empty ring leaves its gap; ids that descend
    (Ouster counts from the top) are turned round; others (a VLP-16's laser ids) are ranked by median elevation.

    Args:
        clouds: pairs of (N, 3) float32 points in the LiDAR's frame and (N,) int64 ids.
    """
    ids, elevation, enough = _median_elevations(clouds)
    lines = next((n for n in _LINE_COUNTS if len(ids) and n > ids[-1]), int(ids[-1]) + 1 if len(ids) else 1)
    identity = np.arange(lines, dtype=np.int32)
    steps = np.diff(elevation[enough])
    rises = len(ids) == 0 or elevation[-1] >= elevation[0]
    if rises and (steps > -_CLEAR_STEP_DEG).all():
        return RingOrder(identity, lines, "")
    if not rises and (steps < _CLEAR_STEP_DEG).all():
        return RingOrder(
            identity[::-1].copy(), lines, f"ring ids count from the top; they were turned round (0 to {lines - 1})."
        )
    table = np.full(int(ids[-1]) + 1, -1, np.int32)
    table[ids[np.argsort(elevation, kind="stable")]] = np.arange(len(ids), dtype=np.int32)
    return RingOrder(table, len(ids), "ring ids do not follow elevation; rings were renumbered, 0 the lowest.")


def _median_elevations(
    clouds: Sequence[tuple[NDArray[np.float32], NDArray[np.int64]]],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Ids that appear, ascending; median elevation of each in degrees; whether it rests on enough points."""
    xyz = np.concatenate([np.zeros((0, 3)), *(xyz.astype(np.float64) for xyz, _ in clouds)])
    ring = np.concatenate([np.zeros(0, np.int64), *(ring for _, ring in clouds)])
    usable = (ring >= 0) & (ring < 65536)
    xyz, ring = xyz[usable], ring[usable]
    elevation = np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    order = np.argsort(ring, kind="stable")
    ids, starts, counts = np.unique(ring[order], return_index=True, return_counts=True)
    parts = np.split(elevation[order], starts[1:]) if len(ids) else []
    medians = np.array([np.median(part) for part in parts], np.float64)
    return ids, medians, counts >= min(_ENOUGH_POINTS, int(counts.max(initial=1)))
