"""Which camera frame belongs to a vertex: the nearest in time to the moment its point was measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

# The gap of a vertex that has no frame at all to be compared with.
NO_FRAME_GAP_NS = int(np.iinfo(np.int64).max)


def pair(
    vertex_times_ns: ArrayLike, frame_stamps_ns: ArrayLike, *, offset_ns: int = 0, max_gap_ns: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pair each vertex with the camera frame nearest to its own time.

    Args:
        vertex_times_ns: (N,) when each vertex point was measured, UTC nanoseconds (LiDAR clock).
        frame_stamps_ns: (M,) stamps of the camera frames, UTC nanoseconds, in any order.
        offset_ns: what the camera's clock shows more than the LiDAR's at the same moment; it is added to
            the vertex times.
        max_gap_ns: farther frames are no pair.

    Returns:
        (N,) int64 index of the frame, -1 where none is near enough; (N,) int64 signed gap in nanoseconds,
        frame minus vertex time (that of the nearest frame also where it is too far;
        :data:`NO_FRAME_GAP_NS` without frames). Of two frames equally near the earlier is taken.

    Raises:
        ValueError: max_gap_ns is negative.
    """
    if max_gap_ns < 0:
        raise ValueError(f"max_gap_ns must not be negative, got {max_gap_ns}")
    times = np.asarray(vertex_times_ns, np.int64).reshape(-1) + np.int64(offset_ns)
    stamps = np.asarray(frame_stamps_ns, np.int64).reshape(-1)
    if stamps.size == 0:
        return np.full(times.size, -1, np.int64), np.full(times.size, NO_FRAME_GAP_NS, np.int64)
    order = np.argsort(stamps, kind="stable")
    stamps = stamps[order]
    right = np.searchsorted(stamps, times, side="left")
    after = np.minimum(right, stamps.size - 1)
    before = np.maximum(right - 1, 0)
    take_before = np.abs(times - stamps[before]) <= np.abs(stamps[after] - times)
    nearest = np.where(take_before, before, after)
    gap = stamps[nearest] - times
    index = np.where(np.abs(gap) <= max_gap_ns, order[nearest], -1)
    return index.astype(np.int64), gap
