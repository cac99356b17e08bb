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
# Shots on either side, by azimuth, among which a laser of one of several merged sensors has its own last or next one.
_BESIDE: Final = 6
_MERGED_SHARE: Final = 0.9
# Steps from neighbour to neighbour that are larger by azimuth, but not in the file, which holds one sensor's points
# after the other's. Leaves and damage make as many by azimuth as in the file.
_ALTERNATING: Final = 0.15

RINGLESS: Final = (
    "Of a sensor without rings, as a Livox is, the board is found only where it stands still: record six poses or "
    "more, the board still for two seconds in each, and say `--still`."
)
"""What boards of sensors without rings need; every sentence on them says it with these words."""


def check_rings(clouds: Sequence[tuple[NDArray[np.float32], NDArray[np.int64]]], where: str, field: str) -> None:
    """Refuse numbers whose points, one beside the other in azimuth, jump in elevation for the most part.

    Args:
        clouds: pairs of (N, 3) float32 points and (N,) int64 ring ids, one pair for each sweep.
        where: names the LiDAR in messages.
        field: the column of the ids.

    Raises:
        ReadError: ``points_without_rings``; ``cloud_merged`` where each number stands for a ring of several sensors.
    """
    parts = [_steps(xyz, ring) for xyz, ring in clouds]
    jumps, in_file, nearest = (np.concatenate([np.zeros(0), *(part[index] for part in parts)]) for index in range(3))
    if len(jumps) < _FEWEST:
        return
    typical_deg = float(np.median(jumps))
    more = float(np.mean(jumps > _NEIGHBOURS_DEG)) - float(np.mean(in_file > _NEIGHBOURS_DEG))
    is_near = float(np.mean(nearest < _NEIGHBOURS_DEG)) > _MERGED_SHARE
    if is_near and (more > _ALTERNATING or typical_deg >= _NEIGHBOURS_DEG):
        raise ReadError(
            "cloud_merged",
            f"{where} holds the points of several LiDARs in one cloud: points of one {field} lie side by side at "
            "several elevations, as seen from several places.",
            "Record the topic that each LiDAR's own driver publishes, in the LiDAR's own frame and before the clouds "
            "are merged, and choose one of them.",
        )
    if typical_deg >= _NEIGHBOURS_DEG:
        raise ReadError(
            "points_without_rings",
            f"{where} numbers its points in {field}, but not by the rings of a spinning LiDAR: neighbours of equal "
            f"number differ by {typical_deg:.1f} degrees in elevation.",
            RINGLESS,
        )


def _steps(xyz: NDArray[np.float32], ring: NDArray[np.int64]) -> tuple[NDArray[np.float64], ...]:
    """Degrees of elevation from each point to the next of its number by azimuth, to the next one in the file, and to
    the nearest of twelve beside it by azimuth.
    """
    x, y, z = xyz.astype(np.float64).T
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y)))
    in_file = np.argsort(ring, kind="stable")
    order = np.lexsort((np.arctan2(y, x), ring))
    number = ring[order]
    is_same = np.diff(number) == 0
    nearest = np.full(len(order), np.inf)
    for away in range(1, _BESIDE + 1):
        step = np.abs(elevation[order][away:] - elevation[order][:-away])
        step[number[away:] != number[:-away]] = np.inf
        nearest[away:] = np.minimum(nearest[away:], step)
        nearest[:-away] = np.minimum(nearest[:-away], step)
    by_azimuth, as_filed = (np.abs(np.diff(elevation[row]))[is_same] for row in (order, in_file))
    return by_azimuth, as_filed, nearest
