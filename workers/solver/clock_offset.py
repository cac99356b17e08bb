"""How much the camera's clock shows more than the LiDAR's, estimated from the moving board.

The offset is one more unknown of the least squares: a mark belongs to its frame's own stamp, and the apex was at
track(stamp - offset). The apex's velocity makes the pixel depend on the offset.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

SEARCH_NS: Final = 150_000_000


class TrackPoints(Protocol):
    """The apex at M moments; `workers.vertices.tracks.TrackPoints` is one."""

    @property
    def xyz(self) -> NDArray[np.float64]: ...
    @property
    def velocity(self) -> NDArray[np.float64]: ...
    @property
    def covariance_xyz(self) -> NDArray[np.float64]: ...
    @property
    def gap_ns(self) -> NDArray[np.int64]: ...


class Track(Protocol):
    """Where the apex was at any moment of the LiDAR's clock; `workers.vertices.tracks.Track` is one."""

    def at(self, times_ns: ArrayLike) -> TrackPoints: ...


@dataclass(frozen=True)
class OffsetEstimate:
    """The camera's clock minus the LiDAR's, as `pairing.offset_ns` wants it.

    Attributes:
        offset_ns, sigma_ns: the estimate and its standard deviation.
        rms_px: root mean square distance of the marks that were kept.
        pairs: how many marks were used; outliers: how many were left out as blunders or for want of vertices nearby.
        mean_speed_px_s: how fast the apex moved in the image, root mean square.
        message: the result in one sentence.
    """

    offset_ns: int
    sigma_ns: int
    rms_px: float
    pairs: int
    outliers: int
    mean_speed_px_s: float
    message: str

    def to_document(self) -> dict[str, Any]:
        """JSON form."""
        return dict(vars(self))


def estimate_offset(
    track: Track,
    frame_stamps_ns: ArrayLike,
    pixels: ArrayLike,
    request: Mapping[str, Any],
    *,
    search_ns: int = SEARCH_NS,
) -> OffsetEstimate:
    """Estimate the offset together with the camera.

    Args:
        track: the apex over time, LiDAR clock.
        frame_stamps_ns: (N,) stamps of the marked frames, camera clock.
        pixels: (N, 2) the marks.
        request: what `problem.problem_from_document` takes: model, image_size, nominal and, where known, bounds,
            locked, priors. Known intrinsics make the offset no better, but need fewer marks.
        search_ns: offsets of at most this size, either sign, are looked for.

    Raises:
        InputError: ``offset_not_determined``, the motion or the marks do not tell it; SolveError for a bad request.
    """
    raise NotImplementedError
