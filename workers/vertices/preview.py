"""What a region keeps of a recording, shown before a detection is asked for."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.analyses import RegionPreview, RingCount
from workers.readers.recording import Sweep
from workers.vertices.region import Region


def preview(sweeps: Iterable[Sweep], region: Region) -> RegionPreview:
    """Count what ``region`` keeps."""
    kept_per_frame: list[int] = []
    points = 0
    all_rings: NDArray[np.int64] = np.zeros(0, np.int64)
    kept_rings: NDArray[np.int64] = np.zeros(0, np.int64)
    for sweep in sweeps:
        inside = region.mask(sweep.xyz)
        kept_per_frame.append(int(np.count_nonzero(inside)))
        points += inside.size
        all_rings = _add(all_rings, sweep.ring)
        kept_rings = _add(kept_rings, sweep.ring[inside])
    kept_rings = np.pad(kept_rings, (0, all_rings.size - kept_rings.size))
    return RegionPreview(
        frames=len(kept_per_frame),
        frames_kept=sum(count > 0 for count in kept_per_frame),
        points=points,
        points_kept=sum(kept_per_frame),
        points_per_frame_median=float(np.median(kept_per_frame)) if kept_per_frame else 0.0,
        per_ring=[
            RingCount(ring=int(ring), points=int(all_rings[ring]), points_kept=int(kept_rings[ring]))
            for ring in np.flatnonzero(all_rings)
        ],
    )


def _add(counts: NDArray[np.int64], ring: NDArray[np.uint16]) -> NDArray[np.int64]:
    more = np.bincount(ring, minlength=counts.size)
    more[: counts.size] += counts
    return more
