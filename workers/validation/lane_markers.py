"""Lane markers of a sweep: points on the ground that are brighter than the ground around them on their ring."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from workers.geometry.ground import GroundPlane, ground_plane, is_on
from workers.readers.recording import Sweep
from workers.validation.local_excess import local_excess

Floats = NDArray[np.float64]
# scipy publishes no types.
# pyright: reportMissingTypeStubs=false

# Wider than a lane (2.7 to 3.7 m), so that the median of a window is the road although a crosswalk's stripes fill
# up to half of it.
WINDOW_M: Final = 4.0
# Of a thousand points of plain road less than one lies so far above, if their noise is anything like Gaussian.
BRIGHT: Final = 5.0
# A point of a marker that lies between points of it may be dark.
_GAP_POINTS: Final = 2
# Intensities of a ring's neighbours on one marker are at most this much farther apart than the rings on the ground.
_STRETCH: Final = 1.5


class Markers(NamedTuple):
    """The lane markers that a sweep shows.

    Attributes:
        points: (N, 3) of the markers, metres, LiDAR frame.
        marker: (N,) which of `total` markers each belongs to.
        total: number of markers.
        plain: (M, 3), other points of the ground.
        ground: its plane; None where there is none.
    """

    points: Floats
    marker: NDArray[np.int64]
    total: int
    plain: Floats
    ground: GroundPlane | None


def lane_markers(sweep: Sweep) -> Markers:
    """The markers on the ground of a sweep, and the ground beside them."""
    points = sweep.xyz.astype(np.float64)
    plane = ground_plane(points)
    if plane is None:
        return _none()
    on = np.flatnonzero(is_on(plane, points))
    excess = np.full(len(on), np.nan)
    run = np.full(len(on), -1)
    intensity = sweep.intensity[on].astype(np.float64)
    steps = np.diff(np.unique(intensity))
    floor = float(steps.min()) if len(steps) else 1.0
    azimuth = np.arctan2(points[on, 1], points[on, 0])
    runs = 0
    for ring in np.unique(sweep.ring[on]):
        of_ring = np.flatnonzero(sweep.ring[on] == ring)
        of_ring = of_ring[np.argsort(azimuth[of_ring], kind="stable")]
        along = np.linalg.norm(np.diff(points[on[of_ring]], axis=0), axis=1)
        # A gap, as behind a car, ends what one window holds.
        position = np.concatenate([[0.0], np.cumsum(np.minimum(along, WINDOW_M))])
        excess[of_ring] = local_excess(position, intensity[of_ring], WINDOW_M, floor)
        bright = np.flatnonzero(excess[of_ring] > BRIGHT)
        if len(bright):
            number = runs + np.concatenate([[0], np.cumsum(np.diff(bright) > _GAP_POINTS)])
            run[of_ring[bright]] = number
            runs = int(number[-1]) + 1
    bright = run >= 0
    if not bright.any():
        return _none()._replace(plain=points[on[excess < BRIGHT]], ground=plane)
    marker = _joined(points[on[bright]], sweep.ring[on[bright]].astype(np.int64), run[bright])
    plain = points[on[excess < BRIGHT]]
    return Markers(points[on[bright]], marker, int(marker.max()) + 1, plain, plane)


def _none() -> Markers:
    return Markers(np.zeros((0, 3)), np.zeros(0, np.int64), 0, np.zeros((0, 3)), None)


def _joined(points: Floats, ring: NDArray[np.int64], run: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) markers: runs on neighbouring rings are one where they are about as close as the rings are."""
    count = int(run.max()) + 1
    middle = np.stack([np.bincount(run, points[:, axis], count) for axis in range(3)], axis=1)
    middle /= np.bincount(run, minlength=count)[:, None]
    of_ring = np.zeros(count, np.int64)
    of_ring[run] = ring
    distance = np.hypot(middle[:, 0], middle[:, 1])
    apart = np.hypot(*(middle[:, None, :2] - middle[None, :, :2]).transpose(2, 0, 1))
    spacing = np.abs(distance[:, None] - distance[None, :])
    neighbours = np.abs(of_ring[:, None] - of_ring[None, :]) == 1
    first, second = np.nonzero(neighbours & (apart < _STRETCH * np.maximum(spacing, 0.1)))
    links = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    return np.asarray(sparse.csgraph.connected_components(links, directed=False)[1], np.int64)[run]
