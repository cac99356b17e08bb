"""Each pair under a result: where its vertex projects, how far its mark lies from there, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import FitResult, HeldOut
from apexcal.geometry.se3 import from_document
from workers.geometry.models import parse_model
from workers.geometry.projection import distances_px, image_diagonal_px, project

Floats = NDArray[np.float64]


class PairErrors(NamedTuple):
    """Of N pairs: projection and mark minus projection (N, 2) px, NaN without a projection; distance (N,) px.

    ``range_m`` (N,) from the LiDAR, ``angle_deg`` (N,) between the point and the camera's axis.
    """

    projected: Floats
    off: Floats
    distance_px: Floats
    range_m: Floats
    angle_deg: Floats

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(N,) whether the pair has a projection."""
        return np.isfinite(self.projected[:, 0])


def pair_errors(result: FitResult, xyz: Floats, marks: Floats) -> PairErrors:
    """The pairs (N, 3), metres in the LiDAR's frame, and (N, 2), pixels, under a result's transform and lens.

    ``xyz`` are those that were fitted: of a rolling shutter, where the vertex was when its mark's row was read.
    """
    lens = result.intrinsics
    in_camera = from_document(result.transform).apply(xyz)
    projected, violation = project(parse_model(lens.model), lens.by_name(), in_camera)
    distance = distances_px(projected, violation, marks, image_diagonal_px(lens.image_size))
    angle = np.degrees(np.arctan2(np.hypot(in_camera[:, 0], in_camera[:, 1]), in_camera[:, 2]))
    return PairErrors(projected, marks - projected, distance, np.linalg.norm(xyz, axis=1), angle)


def held_out_px(folds: Sequence[HeldOut], count: int) -> Floats:
    """(N,) each pair's distance under the fit that held it out, px; NaN where none did."""
    errors_px = np.full(count, np.nan)
    for heldout in folds:
        errors_px[np.asarray(heldout.indices, np.int64)] = heldout.errors_px
    return errors_px


def rings_of(errors: PairErrors, used: NDArray[np.bool_], count: int = 4) -> list[dict[str, float]]:
    """Return rings about the axis with equally many of the used pairs (N,): angles, pairs, RMS distance px."""
    used = used & errors.seen
    if not np.any(used):
        return []
    angle, distance = errors.angle_deg[used], errors.distance_px[used]
    edges = np.quantile(angle, np.linspace(0.0, 1.0, count + 1))
    ring = np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, count - 1)
    return [
        {
            "from_deg": float(edges[k]),
            "to_deg": float(edges[k + 1]),
            "pairs": int(np.count_nonzero(ring == k)),
            "rms_px": float(np.sqrt(np.mean(distance[ring == k] ** 2))),
        }
        for k in range(count)
        if np.any(ring == k)
    ]
