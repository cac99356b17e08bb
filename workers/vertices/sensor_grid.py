"""The sensor's grid: elevation and azimuth step of each ring, how rings are shifted, and which way is up.

A normalised recording holds returns only. But a spinning sensor fires at even steps, so rays without a return can be
restored once some sweeps have shown the steps. How a board is held is measured against gravity, not against the
sensor's z: a sensor may be tilted or upside down.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.geometry.ground import STEEPEST_DEG, GroundPlane, ground_plane, is_on
from workers.readers.recording import Sweep
from workers.vertices.sweep_source import Scattered, SweepSource, spread

Floats = NDArray[np.float64]

_LEANS_AT_MOST_DEG: Final = 35.0  # of an unknown mount
# Streets fall by up to 2.5 % across and 6 % along (AASHTO Green Book), together 3.7 degrees. Up to such a tilt the
# ground is no better a sign of gravity than the sensor's z.
_STREETS_DEG: Final = 4.0
_LEAST_SHARE: Final = 0.05
_BELOW_M: Final = 0.5
_MOST_BELOW: Final = 0.05  # of the points; no surface lies below the ground, but mirrors and dust give some
_OTHER_RINGS: Final = 0.2
_LOWEST_M: Final = 0.2  # no sensor is mounted nearer to the ground
# In a hall floor and ceiling are about as large. Sensors are rarely upside down.
_MUCH_MORE: Final = 3.0
_FLIPPED: Final = np.diag([1.0, -1.0, -1.0])


def find_up(xyz: Floats, ring: NDArray[np.int64], stated: Floats | None = None) -> Floats:
    """Return the direction of up (3,), of unit length, in the LiDAR frame.

    Args:
        xyz: (N, 3) points of some sweeps, metres, LiDAR frame; ring: (N,).
        stated: (3,) as the rig states it; the ground corrects it by up to 15 degrees. Without it the sensor may stand
            upright or upside down, tilted by up to 35 degrees.

    Returns:
        The ground's normal. If no ground is seen, or its normal is within 4 degrees: the sensor's z, or the stated
        up.
    """
    if stated is not None:
        turned = _to_level(stated / np.linalg.norm(stated))
        ground = _ground(xyz @ turned.T, ring, STEEPEST_DEG)
        return turned[2] if ground is None else _corrected(ground[0].normal) @ turned
    upright, flipped = _ground(xyz, ring, _LEANS_AT_MOST_DEG), _ground(xyz @ _FLIPPED, ring, _LEANS_AT_MOST_DEG)
    if flipped is not None and (upright is None or flipped[1] > _MUCH_MORE * upright[1]):
        return _corrected(flipped[0].normal) @ _FLIPPED
    return np.array([0.0, 0.0, 1.0]) if upright is None else _corrected(upright[0].normal)


def level_rotation(up: Floats) -> Floats:
    """Return R_level_lidar (3, 3): z up, x horizontal and nearest to the LiDAR's x; exactly 1 if up is its z."""
    return np.eye(3) if up[2] == 1.0 else _to_level(up)


def _to_level(up: Floats) -> Floats:
    ahead = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = ahead - up * (ahead @ up)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(up, x), up])


def _corrected(normal: Floats) -> Floats:
    within = math.degrees(math.acos(min(float(normal[2]), 1.0))) < _STREETS_DEG
    return np.array([0.0, 0.0, 1.0]) if within else normal


def _ground(xyz: Floats, ring: NDArray[np.int64], steepest_deg: float) -> tuple[GroundPlane, int] | None:
    """Return the ground below a sensor whose z is about up, and how many points lie on it."""
    plane = ground_plane(xyz, steepest_deg)
    if plane is None or plane.offset < _LOWEST_M:
        return None
    on = is_on(plane, xyz)
    count = int(np.count_nonzero(on))
    below = float(np.mean(plane.height(xyz) < -_BELOW_M))
    # One ring is a cone, and can lie in a plane by itself whatever it meets.
    others = count - int(np.bincount(ring[on]).max())
    sure = count > _LEAST_SHARE * len(xyz) and below < _MOST_BELOW and others > _OTHER_RINGS * count
    return (plane, count) if sure else None


# Azimuth steps of the sensors there are lie between these; smaller ones are twin returns, larger ones are gaps.
_STEP_RAD = (math.radians(0.03), math.radians(1.6))
_DEFAULT_STEP_RAD = math.radians(0.2)
_BLOCK_RAD = math.radians(10.0)  # so short that a motor's wavering does not blur the grid
_ENOUGH = 5
# A ring has its own step if it has this many gaps between returns; 15 % or more of these are a single step.
_ENOUGH_STEPS, _LOW_QUANTILE = 30, 0.15
_SAME_STEP = 0.25
_GROUND_POINTS = 1000  # of each sweep
# No sensor has more rings. A larger number belongs to a damaged point, and tables by ring stay small without it.
MOST_RINGS = 256


@dataclass(frozen=True, slots=True, eq=False)
class SensorGrid:
    """The directions in which a sensor fires.

    Attributes:
        elevation: (R,) radians, of each ring, 0 the lowest; interpolated for rings without a return; NaN for rings
            below the lowest one with a return.
        steps: (R,) radians between two firings of each ring.
        shift: (R,) radians, azimuth of each ring's grid against that of the others of its step, modulo the step.
        R_level_lidar: (3, 3) to axes whose z is up.
        scattered: whether the sensor has no rings, so that rings are cells of elevation (`sweep_source.Scattered`).
    """

    elevation: Floats
    steps: Floats
    shift: Floats
    R_level_lidar: Floats
    scattered: bool = False

    @property
    def step(self) -> float:
        """The finest of the steps, radians."""
        return float(self.steps.min())


def learn_grid(sweeps: Iterable[Sweep], up: Floats | None = None) -> SensorGrid:
    """Return the grid of a sensor from some of its sweeps; a default one from sweeps without points.

    Points of rings from ``MOST_RINGS`` on are ignored.

    Args:
        up: (3,) direction of up in the LiDAR frame as the rig states it; None: from the ground.
    """
    rings: list[NDArray[np.int64]] = []
    azimuths: list[Floats] = []
    elevations: list[Floats] = []
    some: list[tuple[Floats, NDArray[np.int64]]] = []
    for number, sweep in enumerate(sweeps):
        real = (sweep.ring < MOST_RINGS) & np.isfinite(sweep.xyz).all(axis=1)
        x, y, z = sweep.xyz[real].astype(np.float64).T
        ring = sweep.ring[real].astype(np.int64)
        azimuth = np.arctan2(y, x)
        order = np.lexsort((azimuth, ring))
        # Each sweep's azimuths stand a turn apart, so that differences and blocks never span two sweeps.
        azimuths.append(azimuth[order] + number * 4.0 * math.pi)
        elevations.append(np.arctan2(z, np.hypot(x, y))[order])
        rings.append(ring[order])
        few = order[:: max(1, order.size // _GROUND_POINTS)]
        some.append((sweep.xyz[real][few].astype(np.float64), ring[few]))
    ring = np.concatenate([np.zeros(0, np.int64), *rings])
    azimuth = np.concatenate([np.zeros(0), *azimuths])
    count = int(ring.max(initial=0)) + 1
    elevation = _elevations(ring, np.concatenate([np.zeros(0), *elevations]), count)
    steps = _steps(ring, azimuth, count)
    shift = np.zeros(count)
    for step in np.unique(steps):
        alike = steps == step
        shift[alike] = _shifts(ring[alike[ring]], azimuth[alike[ring]], float(step), count)[alike]
    xyz = np.concatenate([np.zeros((0, 3)), *(part for part, _ in some)])
    of = np.concatenate([np.zeros(0, np.int64), *(part for _, part in some)])
    return SensorGrid(elevation, steps, shift, level_rotation(find_up(xyz, of, up)))


def some_grid(source: SweepSource, sweeps: int = 4, up: Floats | None = None) -> SensorGrid:
    """Return the grid of a sensor from a few sweeps of its recording; ``up`` as of `learn_grid`."""
    grid = learn_grid((source.sweep(number) for number in spread(len(source), sweeps)), up)
    return replace(grid, scattered=isinstance(source, Scattered))


def _elevations(ring: NDArray[np.int64], elevation: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    order = np.argsort(ring, kind="stable")
    parts = np.split(elevation[order], np.searchsorted(ring[order], np.arange(1, count)))
    medians = np.array([np.median(part) if part.size else np.nan for part in parts])
    measured = np.flatnonzero(np.isfinite(medians))
    if measured.size < 2:
        return np.nan_to_num(medians)
    filled: Floats = np.interp(np.arange(count), measured, medians[measured], left=np.nan)
    return filled


def _steps(ring: NDArray[np.int64], azimuth: Floats, count: int) -> Floats:
    """Return (R,) the step of each ring: the usual one, unless the ring's returns clearly show another."""
    apart = np.diff(azimuth)
    beside = (np.diff(ring) == 0) & (apart > _STEP_RAD[0]) & (apart < _STEP_RAD[1])
    apart, of = apart[beside], ring[1:][beside]
    if apart.size == 0:
        return np.full(count, _DEFAULT_STEP_RAD)
    # The median is taken from the gaps themselves: between two kinds of gaps none may be within a quarter of it.
    usual = _mean_about(apart, float(np.quantile(apart, 0.5, method="lower")))
    steps = np.full(count, usual)
    ends = np.searchsorted(of, np.arange(count + 1))
    low = np.array([_low(apart[a:b], usual) for a, b in pairwise(ends.tolist())])
    # Rings of one step are put together, so that rings without returns can take their phase from others.
    while (other := np.abs(low - usual) > _SAME_STEP * usual).any():
        alike = np.abs(low - low[other][0]) <= _SAME_STEP * low[other][0]
        steps[alike] = _mean_about(apart[alike[of]], float(low[other][0]))
        low[alike] = usual
    return steps


def _low(apart: Floats, usual: float) -> float:
    """Return the step of one ring from its smallest gaps; gaps across missing returns are multiples of the step."""
    return float(np.quantile(apart, _LOW_QUANTILE, method="lower")) if apart.size >= _ENOUGH_STEPS else usual


def _mean_about(apart: Floats, middle: float) -> float:
    return float(np.mean(apart[np.abs(apart - middle) < _SAME_STEP * middle]))


def _shifts(ring: NDArray[np.int64], azimuth: NDArray[np.float64], step: float, count: int) -> NDArray[np.float64]:
    """Return the circular mean, over short blocks of azimuth, of each ring's phase against the fullest ring's."""
    if ring.size == 0:
        return np.zeros(count)
    block = np.floor(azimuth / _BLOCK_RAD).astype(np.int64)
    block -= block.min()
    fullest = int(np.argmax(np.bincount(ring, minlength=count)))
    sums, counts = _phases(ring, block, azimuth, 2.0 * math.pi / step, count, int(block.max()) + 1)
    usable = (counts >= _ENOUGH) & (counts[fullest] >= _ENOUGH)
    against = np.where(usable, sums * np.conj(sums[fullest]), 0.0).sum(axis=1)
    shift: NDArray[np.float64] = np.angle(against) * step / (2.0 * math.pi)
    return shift


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _phases(
    ring: NDArray[np.int64],
    block: NDArray[np.int64],
    azimuth: NDArray[np.float64],
    rate: float,
    rings: int,
    blocks: int,
) -> tuple[NDArray[np.complex128], NDArray[np.int64]]:
    sums = np.zeros((rings, blocks), np.complex128)
    counts = np.zeros((rings, blocks), np.int64)
    for i in range(ring.size):
        angle = azimuth[i] * rate
        sums[ring[i], block[i]] += complex(math.cos(angle), math.sin(angle))
        counts[ring[i], block[i]] += 1
    return sums, counts
