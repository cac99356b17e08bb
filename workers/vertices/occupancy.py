"""What stands still in a recording: how often each place along each beam gave a return.

A place is (ring, azimuth, range): half a degree wide, and deeper the farther away it is, because surfaces that are
met at a grazing angle give ranges that vary.
"""

from __future__ import annotations

import math
from typing import Final

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep

_AZIMUTHS: Final = 720
_DEEPER: Final = 0.02  # growth of a place's depth per depth
_NEAREST_DEPTH_M: Final = 0.15
_RANGES: Final = 180  # up to some 250 m; what is farther falls into the last
_RINGS: Final = 256  # more than any sensor has; what is above counts with the last
STILL_SHARE: Final = 0.5
_BEHIND_SHARE: Final = 0.15

Counts = NDArray[np.uint16]


class Occupancy:
    """Counts of sweeps with a return per place, over the sweeps that were added."""

    def __init__(self) -> None:
        self.sweeps = 0
        self._counts: Counts = np.zeros((0, _AZIMUTHS, _RANGES), np.uint16)
        self._last: Counts = self._counts.copy()

    def add(self, sweep: Sweep) -> None:
        """Count each place that has a return once."""
        self.sweeps += 1
        rings = min(int(sweep.ring.max()) + 1, _RINGS) if sweep.ring.size else 0
        if rings > len(self._counts):
            more = ((0, rings - len(self._counts)), (0, 0), (0, 0))
            self._counts, self._last = np.pad(self._counts, more), np.pad(self._last, more)
        _count(sweep.xyz, sweep.ring, self._counts, self._last, self.sweeps)

    def moving(self, sweep: Sweep) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which points (N,) of a sweep that was added move, and which (N,) stand still; some are neither.

        Still is a point whose place, or one beside it, gave a return in half of the sweeps. Moving is one that is not
        still and hides something: what gave returns behind it, or a sky that gave none.
        """
        return _judge(
            sweep.xyz, sweep.ring, self._counts, STILL_SHARE * self.sweeps, max(1.5, _BEHIND_SHARE * self.sweeps)
        )


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _place(x: float, y: float, z: float) -> tuple[int, int]:
    """Azimuth and range bin of a point; the range bin is -1 where it is no point."""
    distance = math.sqrt(x * x + y * y + z * z)
    if not (math.isfinite(distance) and distance > 0.0):
        return 0, -1
    azimuth = int((math.atan2(y, x) / (2.0 * math.pi) + 0.5) * _AZIMUTHS) % _AZIMUTHS
    depth = math.log(1.0 + distance * _DEEPER / _NEAREST_DEPTH_M) / math.log(1.0 + _DEEPER)
    return azimuth, min(int(depth), _RANGES - 1)


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _count(xyz: NDArray[np.float32], ring: NDArray[np.uint16], counts: Counts, last: Counts, sweep: int) -> None:
    for i in range(xyz.shape[0]):
        a, r = _place(xyz[i, 0], xyz[i, 1], xyz[i, 2])
        k = min(ring[i], _RINGS - 1)
        if r >= 0 and last[k, a, r] != sweep:
            last[k, a, r] = sweep
            counts[k, a, r] += 1


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _judge(
    xyz: NDArray[np.float32], ring: NDArray[np.uint16], counts: Counts, often: float, sometimes: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    moving, still = np.zeros(xyz.shape[0], np.bool_), np.zeros(xyz.shape[0], np.bool_)
    for i in range(xyz.shape[0]):
        a, r = _place(xyz[i, 0], xyz[i, 1], xyz[i, 2])
        if r < 0:
            continue
        row = counts[min(ring[i], _RINGS - 1)]
        most, returns, behind = 0, 0, 0
        for da in range(-1, 2):
            column = row[(a + da) % _AZIMUTHS]
            for dr in range(max(r - 1, 0), min(r + 2, _RANGES)):
                most = max(most, column[dr])
        column = row[a]
        for k in range(_RANGES):
            returns += column[k]
            if k > r + 1:
                behind = max(behind, column[k])
        still[i] = most >= often
        moving[i] = not still[i] and (behind >= sometimes or returns < often)
    return moving, still
