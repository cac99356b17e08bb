"""Pairs: each vertex with the camera frame nearest in time to the moment at which its point was measured.

The vertex may then be moved along its track to the frame's own time, so that no gap is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workers.vertices.tracks import MARGIN_SWEEPS, Track
from workers.vertices.vertex import Vertex

# How far in time from the nearest vertex the track is followed. Within a second a walker at 1.2 m/s turns round;
# farther away a straight line goes on to where nobody walked.
REACH_NS: Final = 1_000_000_000

# People walk at 0.5 to 1.6 m/s and run at 3; a vertex is off by centimetres.
_FASTEST_M_S: Final = 3.0
_NOISE_M: Final = 0.1
_LEAST_STEPS: Final = 3
_MOST_FAST: Final = 0.1

# The gap of a vertex if there is no frame at all.
NO_FRAME_GAP_NS = int(np.iinfo(np.int64).max)


def pair(
    vertex_times_ns: ArrayLike,
    frame_stamps_ns: ArrayLike,
    *,
    offset_ns: int = 0,
    max_gap_ns: int,
    marked: ArrayLike = -1,
    reach_ns: int = 0,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return, for each vertex, the camera frame nearest to its own time, or the one that people marked.

    Args:
        vertex_times_ns: (N,) when each vertex point was measured, UTC nanoseconds (LiDAR clock).
        frame_stamps_ns: (M,) stamps of the camera frames, UTC nanoseconds, in any order.
        offset_ns: camera clock minus LiDAR clock; it is added to the vertex times.
        max_gap_ns: farther frames are no pair.
        marked: (N,) index of the frame in which people marked the vertex, -1 where there is none. It is taken if it
            is no farther than max_gap_ns, or than reach_ns.

    Returns:
        (N,) int64 index of the frame, -1 if none is near enough; (N,) int64 signed gap in nanoseconds, frame minus
        vertex time, also of a frame that is too far (:data:`NO_FRAME_GAP_NS` without frames). Of two frames equally
        near the earlier is taken.

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
    marked = np.asarray(marked, np.int64)
    of_marked = np.asarray(frame_stamps_ns, np.int64).reshape(-1)[marked] - times
    stays = (marked >= 0) & (np.abs(of_marked) <= max(max_gap_ns, reach_ns))
    return np.where(stays, marked, index).astype(np.int64), np.where(stays, of_marked, gap)


@dataclass(frozen=True, slots=True, eq=False)
class MovedVertices:
    """Vertices moved along their track to the moments of their camera frames; one row per vertex.

    Attributes:
        index: (N,) int64 of the frame, -1 where there is no pair: none within max_gap_ns, or the frame's moment lies
            more than `REACH_NS` from the nearest vertex of the track.
        xyz: (N, 3) the apex at the frame's time, metres, LiDAR frame; not a number where there is no pair.
        covariance: (N, 3, 3) over (azimuth rad, elevation rad, range m), the interpolation's error included; not a
            number where there is no pair.
        moved_ns: (N,) int64 signed, frame minus vertex time: over how long the vertex was moved. The gap that is
            left is zero.
    """

    index: NDArray[np.int64]
    xyz: NDArray[np.float64]
    covariance: NDArray[np.float64]
    moved_ns: NDArray[np.int64]


def on_track(vertices: Sequence[Vertex], context: Sequence[Vertex] = ()) -> NDArray[np.bool_]:
    """Return (N,) whether the vertices within `tracks.MARGIN_SWEEPS` sweeps of each form a track of a walker.

    It needs at least three steps of at most a second, of which at most a tenth is faster than a person with a board.
    Still poses form no track: their board is elsewhere in the next sweep.
    """
    whole = sorted([*vertices, *context], key=lambda vertex: (vertex.time_ns, vertex.sweep_index))
    times = np.array([vertex.time_ns for vertex in whole], np.int64)
    sweeps = np.array([vertex.sweep_index for vertex in whole], np.int64)
    xyz = np.array([vertex.xyz for vertex in whole], np.float64).reshape(-1, 3)
    gap = np.diff(times)
    near = (gap > 0) & (gap <= REACH_NS)
    fast = near & (np.linalg.norm(np.diff(xyz, axis=0), axis=1) > _FASTEST_M_S * gap * 1e-9 + _NOISE_M)
    tracked = np.zeros(len(vertices), np.bool_)
    for number, vertex in enumerate(vertices):
        close = np.abs(sweeps - vertex.sweep_index) <= MARGIN_SWEEPS
        steps = close[:-1] & close[1:] & near
        count = np.count_nonzero(steps)
        tracked[number] = count >= _LEAST_STEPS and np.count_nonzero(steps & fast) <= _MOST_FAST * count
    return tracked


def pair_interpolated(
    vertices: Sequence[Vertex],
    frame_stamps_ns: ArrayLike,
    *,
    context: Sequence[Vertex] = (),
    offset_ns: int = 0,
    max_gap_ns: int,
    marked: ArrayLike = -1,
) -> MovedVertices:
    """Return each vertex paired with a frame, as `pair` does, and moved along its track to the frame's time.

    A frame that people marked is taken as far as the track reaches.

    Args:
        vertices: (N,) of a recording or of one of its shards.
        context: vertices of `tracks.MARGIN_SWEEPS` sweeps on either side of the shard, for the track alone.
        offset_ns, max_gap_ns, marked: as for `pair`.

    Raises:
        ValueError: max_gap_ns is negative.
    """
    times = np.array([vertex.time_ns for vertex in vertices], np.int64)
    near = {"offset_ns": offset_ns, "max_gap_ns": max_gap_ns, "reach_ns": REACH_NS}
    index, gap = pair(times, frame_stamps_ns, marked=marked, **near)
    paired = np.flatnonzero(index >= 0)
    xyz, covariance = np.full((len(times), 3), np.nan), np.full((len(times), 3, 3), np.nan)
    if paired.size:
        track = Track.of([*vertices, *context])
        points = track.at(times[paired] + gap[paired], track.places(vertices)[paired])
        within = points.gap_ns <= REACH_NS
        index[paired[~within]] = -1
        paired = paired[within]
        xyz[paired], covariance[paired] = points.xyz[within], points.covariance[within]
    return MovedVertices(index, xyz, covariance, np.where(index >= 0, gap, 0))
