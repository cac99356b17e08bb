"""The board's apex between the sweeps: a smooth track through the vertices near a moment, with its covariance.

The result at a moment depends on the vertices of :data:`MARGIN_SWEEPS` sweeps on either side alone, so it does not
depend on how a recording is cut into shards, as long as each shard knows that many sweeps beyond its edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workers.vertices.vertex import Vertex

MARGIN_SWEEPS: Final = 10


@dataclass(frozen=True, slots=True, eq=False)
class TrackPoints:
    """The track at M moments.

    Attributes:
        xyz: (M, 3) the apex, metres, LiDAR frame.
        velocity: (M, 3) metres per second.
        covariance: (M, 3, 3) of the apex over (azimuth rad, elevation rad, range m), interpolation included.
        covariance_xyz: (M, 3, 3) the same, over x, y, z, square metres.
        gap_ns: (M,) int64 from the nearest vertex of the track, in time.
    """

    xyz: NDArray[np.float64]
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]
    covariance_xyz: NDArray[np.float64]
    gap_ns: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Vertices of one walk in the order of their times.

    Attributes:
        times_ns: (N,) int64, when each vertex point was measured, LiDAR clock.
        sweep: (N,) int64, number of the sweep in its recording.
        xyz: (N, 3) metres, LiDAR frame.
        covariance: (N, 3, 3) over (azimuth rad, elevation rad, range m).
    """

    times_ns: NDArray[np.int64]
    sweep: NDArray[np.int64]
    xyz: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def of(cls, vertices: Sequence[Vertex]) -> Self:
        """The track of vertices in any order; those without a covariance get that of their detector."""
        raise NotImplementedError

    def at(self, times_ns: ArrayLike, centre: ArrayLike | None = None) -> TrackPoints:
        """The track at moments of the LiDAR's clock.

        Args:
            times_ns: (M,) nanoseconds; before the first and after the last vertex the track is continued.
            centre: (M,) index of the vertex about whose sweep the local window lies; None: the nearest in time.

        Raises:
            InputError: ``track_empty``, there is no vertex.
        """
        raise NotImplementedError
