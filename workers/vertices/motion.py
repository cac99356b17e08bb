"""Motion: whether the LiDAR itself drives, and whether one thing walks, or jumps like the board of still poses.

A facade looks the same to a LiDAR that drives along it, so most upright things seem to stand still. Ends of facades,
cars and poles show the drive. Two sweeps are laid on each other as seen from above. If the LiDAR moves, one shift
lays more upright things on themselves than no shift does, to the left of its way and to the right. Traffic that
passes a parked car gains on the side of its lane only, and loses where the parked cars stand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.sweep_source import SweepSource, spread, stamp_of

Floats = NDArray[np.float64]

_PAIRS: Final = 8
_APART_S: Final = (0.0, 1.0)  # neighbours show a drive, sweeps farther apart a LiDAR that creeps
_COLUMNS: Final = 900
_CELL_M: Final = 0.15  # upright surfaces are met within this: accuracy 0.03 m (data sheets), motion during a sweep
_CELLS: Final = 480
_FARTHEST: Final = 27  # cells: 40 m/s in the tenth of a second between two sweeps
_DENSE_M: Final = 0.3  # two cells; farther along a facade the motor's phase decides which cells are met
_BY_CHANCE: Final = 3.0  # standard deviations of a difference of two counts


def is_drive(source: SweepSource, grid: SensorGrid, on_sweep: Callable[[], None] | None = None) -> bool:
    """Return whether the LiDAR moved between the sweeps of most pairs."""
    return any(_is_shifted_mostly(source, grid, apart_s, on_sweep) for apart_s in _APART_S)


def _is_shifted_mostly(
    source: SweepSource, grid: SensorGrid, apart_s: float, on_sweep: Callable[[], None] | None
) -> bool:
    count = len(source)
    if count < 2:
        return False
    step_s = max((stamp_of(source, count - 1) - stamp_of(source, 0)) * 1e-9 / (count - 1), 1e-3)
    gap = max(1, round(apart_s / step_s))
    firsts = spread(count - gap, _PAIRS)
    shifted = 0
    for first in firsts:
        before, other = (_upright(source.sweep(number), grid) for number in (first, first + gap))
        shifted += _is_shifted(before, other)
        if on_sweep is not None:
            on_sweep()
    return 2 * shifted > len(firsts)


def _upright(sweep: Sweep, grid: SensorGrid) -> Floats:
    """Return (N, 2) metres, level axes: points from which the next ring's surface rises more than it recedes.

    A neighbour on the same ring is near each of them.
    """
    rings = grid.elevation.size
    xyz = sweep.xyz.astype(np.float64)
    distance = np.linalg.norm(xyz, axis=1)
    good = np.isfinite(distance) & (distance > 0.0) & (sweep.ring < rings)
    xyz, ring, farthest_first = xyz[good], sweep.ring[good], np.argsort(-distance[good])
    column = ((np.arctan2(xyz[:, 1], xyz[:, 0]) / (2.0 * np.pi) + 0.5) * _COLUMNS).astype(int) % _COLUMNS
    image = np.full((rings, _COLUMNS, 3), np.nan)
    image[ring[farthest_first], column[farthest_first]] = (xyz @ grid.R_level_lidar.T)[farthest_first]
    recedes = np.abs(np.diff(np.linalg.norm(image[..., :2], axis=2), axis=0))
    steep = recedes < np.abs(np.diff(image[..., 2], axis=0))
    upright = np.zeros(image.shape[:2], np.bool_)
    upright[1:] |= steep
    upright[:-1] |= steep
    near = np.linalg.norm((np.roll(image, -1, axis=1) - image)[..., :2], axis=2) < _DENSE_M
    upright &= near | np.roll(near, 1, axis=1)
    points: Floats = image[upright][:, :2]
    return points


def _is_shifted(image: Floats, other: Floats) -> bool:
    """Return whether a shift lays one image on the other better than none does, on both sides of its direction.

    A surface counts by the cells that it takes, not by its points: a near car has many.
    """
    here, there = np.unique(_cells(image), axis=0), _cells(other)
    before, after = np.zeros((2, _CELLS, _CELLS))
    inside = _inside(here)
    before[here[inside, 0], here[inside, 1]] = 1.0
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            wide = there + np.array([dx, dy])
            wide = wide[_inside(wide)]
            after[wide[:, 0], wide[:, 1]] = 1.0
    common = np.fft.irfft2(np.conj(np.fft.rfft2(before)) * np.fft.rfft2(after), s=before.shape)
    near = np.arange(-_FARTHEST, _FARTHEST + 1)
    best = np.unravel_index(int(np.argmax(common[np.ix_(near, near)])), (near.size, near.size))
    shift = near[np.array(best)]
    if np.abs(shift).max() < 2:  # cells: what one surface varies by
        return False

    def on(moved: NDArray[np.int64]) -> NDArray[np.bool_]:
        inside = _inside(moved)
        occupied = np.zeros(len(moved), np.bool_)
        occupied[inside] = after[moved[inside, 0], moved[inside, 1]] > 0.0
        return occupied

    stays, comes = on(here), on(here + shift)
    x, y = (here - _CELLS // 2).T
    left = shift[0] * y > shift[1] * x
    return all(_is_significant(comes & ~stays & side, stays & ~comes & side) for side in (left, ~left))


def _is_significant(gained: NDArray[np.bool_], lost: NDArray[np.bool_]) -> bool:
    """Return whether more is gained than lost, and not by chance."""
    gains, losses = int(np.count_nonzero(gained)), int(np.count_nonzero(lost))
    return gains - losses > _BY_CHANCE * math.sqrt(gains + losses)


def _cells(xy: Floats) -> NDArray[np.int64]:
    return np.floor(xy / _CELL_M).astype(np.int64) + _CELLS // 2


def _inside(cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (cells >= 0) & (cells < _CELLS)
    return inside[:, 0] & inside[:, 1]


APART_S: Final = 1.5  # a track reaches no farther
_FASTEST_M_S: Final = 3.0
_BRISKEST_M_S2: Final = 3.0  # somebody who turns round: 1.4 m/s to and fro within a second
_TREMBLE_M: Final = 0.2
_STAYS_M: Final = 0.1


# Stamp in nanoseconds, x and y in metres.
Place = tuple[int, float, float]


class Steps(NamedTuple):
    """Counts of a thing's walking steps and jumps, and how far it gets between two jumps (m)."""

    walks: int
    jumps: int
    way_m: float


def jumps(places: Sequence[Place]) -> bool:
    """Return whether one thing jumps more often than it walks.

    Steps longer in time than a track reaches do not count, nor do places of another thing, without which the rest
    walks.
    """
    runs = [[at for k, at in enumerate(run) if not _is_outlier(run, k)] for run in _runs(places)]
    steps = [count_steps(run) for run in runs]
    return sum(part.jumps for part in steps) > sum(part.walks for part in steps)


def count_steps(places: Sequence[Place]) -> Steps:
    """Return the steps of one thing between places; standing still counts as neither.

    A walker goes on nearly as before; from pose to pose the next place has nothing to do with the one before.
    """
    walks = jump_count = 0
    start, way_m = next(iter(places), (0, 0.0, 0.0)), 0.0
    for before, at, after in zip(places, places[1:], places[2:], strict=False):
        if _is_jump(before, at, after):
            jump_count += 1
            start = after
            continue
        walks += not _stays(before, at, after)
        way_m = max(way_m, math.dist(start[1:], after[1:]))
    return Steps(walks, jump_count, way_m)


def _stays(before: Place, at: Place, after: Place) -> bool:
    return max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:])) < _STAYS_M


def _is_jump(before: Place, at: Place, after: Place) -> bool:
    """Return whether nobody walks through these three places at their times."""
    step_s = max(at[0] - before[0], after[0] - at[0]) * 1e-9
    step_m = max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:]))
    bend_m = math.hypot(*(after[k] - 2.0 * at[k] + before[k] for k in (1, 2)))
    too_far = step_m > _TREMBLE_M + _FASTEST_M_S * step_s
    too_bent = bend_m > _TREMBLE_M + _BRISKEST_M_S2 * step_s**2
    return not _stays(before, at, after) and (step_s > APART_S or too_far or too_bent)


def _runs(places: Sequence[Place]) -> list[list[Place]]:
    """Return the places in runs that a track joins."""
    runs: list[list[Place]] = []
    for at in places:
        if not runs or at[0] - runs[-1][-1][0] > APART_S * 1e9:
            runs.append([])
        runs[-1].append(at)
    return runs


def _is_outlier(run: Sequence[Place], k: int) -> bool:
    """Return whether place ``k`` of a run makes a jump that the run has not without it."""
    others = [*run[max(k - 2, 0) : k], *run[k + 1 : k + 3]]
    if not 0 < k < len(run) - 1 or len(others) < 3 or not _is_jump(*run[k - 1 : k + 2]):
        return False
    return not any(_is_jump(*three) for three in zip(others, others[1:], others[2:], strict=False))
