"""Whether numbers that a file calls rings are rings: a spinning laser keeps its elevation from shot to shot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import ReadError

# A laser keeps its elevation to some hundredths of a degree. In a tilted cloud it changes by 0.01 from shot to shot.
_NEIGHBOURS_DEG: Final = 0.5
_FEWEST: Final = 200


def check_rings(clouds: Sequence[tuple[NDArray[np.float32], NDArray[np.int64]]], where: str) -> None:
    """Refuse numbers whose points, one beside the other in azimuth, jump in elevation for the most part.

    Args:
        clouds: pairs of (N, 3) float32 points and (N,) int64 ring ids, one pair for each sweep.
        where: names the LiDAR in messages.

    Raises:
        ReadError: ``points_without_rings``.
    """
    jumps = np.concatenate([np.zeros(0), *(_jumps(xyz.astype(np.float64), ring) for xyz, ring in clouds)])
    if len(jumps) < _FEWEST or float(np.median(jumps)) < _NEIGHBOURS_DEG:
        return
    raise ReadError(
        "points_without_rings",
        f"{where} numbers its points, but not by the rings of a spinning LiDAR: neighbours of equal number differ "
        f"by {float(np.median(jumps)):.1f} degrees in elevation.",
        "A Livox or another solid-state sensor has no rings: record still poses with it, and say so (`--still`).",
    )


def _jumps(xyz: NDArray[np.float64], ring: NDArray[np.int64]) -> NDArray[np.float64]:
    """Degrees of elevation between points of equal number that are neighbours in azimuth."""
    x, y, z = xyz.T
    order = np.lexsort((np.arctan2(y, x), ring))
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y)))[order]
    return np.abs(np.diff(elevation))[np.diff(ring[order]) == 0]
