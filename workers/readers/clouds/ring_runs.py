"""Rings from the order of points in a file that lists ring after ring, as KITTI's do.

Within a ring azimuth runs one way round; where it falls back the next ring begins (scan unfolding: Triess et al.,
Scan-based Semantic Segmentation of LiDAR Point Clouds, 2020). This tells the rings of a sensor whose lasers sit so
far apart that their elevations, seen from one point, overlap (HDL-64E: two blocks of lasers).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.elevations import elevations

# Line counts of the sensors on the market.
LINE_COUNTS: Final = (1, 4, 8, 16, 20, 32, 40, 64, 80, 96, 120, 128, 192, 256)
_BACK: Final = 0.05  # turns
_FEW: Final = 0.02  # of the usual run's points: no ring, but a start or an end that lies on the seam's other side


@dataclass(frozen=True, slots=True)
class RunOrder:
    """The order in which the runs, one turn each, follow each other.

    Attributes:
        direction: +1 where azimuth grows along a run, -1 where it falls.
        seam: azimuth in turns, times the direction, at which runs begin.
        typical: (M,) float64 degrees, the usual median elevation of each run, in the order of the file.
        falling: whether the file begins with the highest ring.
    """

    direction: int
    seam: float
    typical: NDArray[np.float64]
    falling: bool

    def number(self, xyz: NDArray[np.float32]) -> NDArray[np.int32]:
        """(N,) int32 ring of (N, 3) points in the order of their file."""
        run = _runs(xyz, self.direction, self.seam)
        if not len(run):
            return run
        index = _align(_medians(xyz, run), self.typical)[run]
        return (len(self.typical) - 1 - index if self.falling else index).astype(np.int32)


def learn_runs(clouds: Sequence[NDArray[np.float32]], expected: int | None) -> RunOrder | None:
    """The order of rings in a file, or None where it does not list ring after ring.

    Args:
        clouds: (N, 3) float32 points of several sweeps in the order of their file.
        expected: number of rings, if the owner knows it.
    """
    filled = [cloud for cloud in clouds if len(cloud) > 1]
    directions = [direction_of(cloud) for cloud in filled]
    if not filled or 0 in directions or len(set(directions)) > 1:
        return None
    seam = _seam(filled, directions[0])
    medians = [_medians(cloud, _runs(cloud, directions[0], seam)) for cloud in filled]
    usual = float(np.median([len(elevations) for elevations in medians]))
    lines = expected or next((n for n in LINE_COUNTS if n >= usual - 0.5), 0)
    whole = [elevations for elevations in medians if len(elevations) == lines]
    if lines < 4 or len(whole) < max(1, len(filled) // 5) or abs(usual - lines) > 0.1 * lines:
        return None
    typical: NDArray[np.float64] = np.median(np.array(whole), axis=0)
    steps = np.diff(typical)
    falling = bool(np.median(steps) < 0)
    one_way = float(np.mean(steps < 0.2 if falling else steps > -0.2))
    return RunOrder(directions[0], seam, typical, falling) if one_way > 0.95 else None


def _turns(xyz: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.arctan2(xyz[:, 1], xyz[:, 0]).astype(np.float64) / (2 * np.pi)


def direction_of(xyz: NDArray[np.float32]) -> int:
    """+1 (counter-clockwise) or -1 where nearly all points of a cloud follow each other one way round, else 0.

    Args:
        xyz: (N, 3) points in the order of their file.
    """
    if len(xyz) < 2:
        return 0
    step = np.mod(np.diff(_turns(xyz)) + 0.5, 1.0) - 0.5
    rising, falling = float(np.mean(step > 0)), float(np.mean(step < 0))
    if float(np.mean(np.abs(step) < _BACK)) < 0.9 or max(rising, falling) < 0.9 * (rising + falling):
        return 0
    return 1 if rising > falling else -1


def _seam(clouds: Sequence[NDArray[np.float32]], direction: int) -> float:
    """Return where runs begin: ahead, behind, aside, or with a cloud; there elevation steps from ring to ring."""
    firsts = [float(_turns(cloud[:1])[0]) * direction for cloud in clouds]
    turns = [_turns(cloud) * direction for cloud in clouds]
    steps = [np.diff(elevations(cloud)) for cloud in clouds]

    def score(seam: float) -> float:
        crossing: list[NDArray[np.float64]] = []
        for turn, step in zip(turns, steps, strict=True):
            phase = np.mod(turn - seam + 1e-6, 1.0)
            crossing.append(step[(phase[:-1] > 1 - _BACK) & (phase[1:] < _BACK)])
        at_seam = np.concatenate(crossing)
        if len(at_seam) < 3 * len(clouds):
            return 0.0
        return max(float(np.mean(at_seam > 0.1)), float(np.mean(at_seam < -0.1)))

    return max([0.0, 0.5, 0.25, 0.75, *firsts], key=score)


def _runs(xyz: NDArray[np.float32], direction: int, seam: float) -> NDArray[np.int32]:
    """(N,) int32 number of the turn to which each point belongs."""
    if not len(xyz):
        return np.zeros(0, np.int32)
    turn = _turns(xyz) * direction
    step = float(np.median(np.abs(np.diff(turn)))) if len(turn) > 1 else 0.0
    turn = np.mod(turn - seam + step / 2, 1.0)
    begins = np.zeros(len(turn), np.bool_)
    begins[1:] = turn[1:] < turn[:-1] - _BACK
    sizes = np.diff(np.flatnonzero(np.concatenate([[True], begins[1:], [True]])))
    few = np.repeat(sizes < _FEW * np.median(sizes), sizes)
    return np.cumsum(begins & ~few, dtype=np.int32)


def _medians(xyz: NDArray[np.float32], run: NDArray[np.int32]) -> NDArray[np.float64]:
    """(M,) median elevation of each run in degrees."""
    starts = np.flatnonzero(np.diff(run)) + 1
    return np.array([np.median(part) for part in np.split(elevations(xyz), starts.tolist())], np.float64)


def _align(measured: NDArray[np.float64], typical: NDArray[np.float64]) -> NDArray[np.int64]:
    """(M,) place of each found run among the typical ones: the order is kept, the sum of differences is least.

    Each run has a place of its own, unless there are more runs than places.
    """
    count, places = len(measured), len(typical)
    if count == places:
        return np.arange(places, dtype=np.int64)
    strict = 1 if count < places else 0
    cost = np.abs(measured[:, None] - typical[None, :])
    best = np.full((count, places), np.inf)
    came = np.zeros((count, places), np.int64)
    best[0] = cost[0]
    for row in range(1, count):
        lowest = np.minimum.accumulate(best[row - 1])
        where = np.maximum.accumulate(np.where(best[row - 1] <= lowest, np.arange(places), 0))
        best[row, strict:] = cost[row, strict:] + lowest[: places - strict]
        came[row, strict:] = where[: places - strict]
    aligned = np.empty(count, np.int64)
    aligned[-1] = int(np.argmin(best[-1]))
    for row in range(count - 1, 0, -1):
        aligned[row - 1] = came[row, aligned[row]]
    return aligned
