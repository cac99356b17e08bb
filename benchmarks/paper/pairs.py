"""Pairs of a recording as people would make them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.recordings import Walked
from workers.simulation.camera import SimulatedCamera
from workers.vertices.pairing import pair, pair_interpolated

Floats = NDArray[np.float64]

CLICK_PX: Final = 1.0
OFFSET_NS: Final = 30_000_000
_MAX_GAP_NS: Final = 50_000_000


@dataclass(frozen=True, eq=False)
class Pairs:
    """N pairs: points (N, 3) metres, marks (N, 2) px, stamps (N,) of the camera's clock, and where they are stated
    the points' deviations (N, 3) of azimuth, elevation and range, else not a number."""

    points: Floats
    marks: Floats
    stamps_ns: NDArray[np.int64]
    sigmas: Floats


def make_pairs(
    walked: Walked,
    camera: SimulatedCamera,
    detector: str,
    offset_ns: int | None,
    repeat: int,
) -> Pairs:
    """As many pairs as the paper has, spread evenly over what the detector found and the camera saw.

    offset_ns: of the clocks; vertices are then moved to the frames. None: it is not known, each takes the nearest.
    """
    vertices = walked.vertices[detector]
    taken = walked.frame_times_ns(repeat)
    stamps = taken + OFFSET_NS
    points = np.array([vertex.xyz for vertex in vertices])
    covariance = np.array([vertex.covariance or np.full((3, 3), np.nan) for vertex in vertices], np.float64)
    if offset_ns is None:
        index, _ = pair([vertex.time_ns for vertex in vertices], stamps, max_gap_ns=_MAX_GAP_NS)
    else:
        moved = pair_interpolated(vertices, stamps, offset_ns=offset_ns, max_gap_ns=_MAX_GAP_NS)
        index, points, covariance = moved.index, moved.xyz, moved.covariance
    chosen = _chosen(walked, camera, index, taken)
    frames = index[chosen]
    marks = camera.project(walked.apex(taken[frames]))
    random = np.random.default_rng([walked.wanted.seed, 22, repeat])
    marks = marks + random.normal(0.0, CLICK_PX, marks.shape)
    return Pairs(points[chosen], marks, stamps[frames], np.sqrt(np.diagonal(covariance[chosen], axis1=1, axis2=2)))


def _chosen(
    walked: Walked, camera: SimulatedCamera, index: NDArray[np.int64], taken: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Vertices with a frame of their own that shows the apex, evenly over the recording."""
    paired = np.flatnonzero(index >= 0)
    _, first = np.unique(index[paired], return_index=True)
    usable = paired[first]
    usable = np.sort(usable[camera.sees(camera.project(walked.apex(taken[index[usable]])))])
    if len(usable) <= walked.wanted.pairs:
        return usable
    return usable[np.round(np.linspace(0, len(usable) - 1, walked.wanted.pairs)).astype(np.int64)]
