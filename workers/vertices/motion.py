"""What moves: the LiDAR itself, or one thing that walks, or jumps as the board of still poses does.

A facade stays where it is for a LiDAR that drives along it, so most of what is upright seems to stand still. What
tells is the rest: ends of facades, cars, poles. Two sweeps are laid on each other as seen from above. If the LiDAR
moves, one shift lays more of what is upright on itself than no shift does, to the left of its way and to the right.
Traffic that passes a parked car gains on the side of its lane only, and what stands there loses.
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
_APART_S: Final = (0.0, 1.0)  # neighbours tell a drive, sweeps farther apart tell that the LiDAR creeps
_COLUMNS: Final = 900
_CELL_M: Final = 0.15  # upright surfaces are met within this: accuracy 0.03 m (data sheets), motion during a sweep
_CELLS: Final = 480
_FARTHEST: Final = 27  # cells: 40 m/s in the tenth of a second between two sweeps
_DENSE_M: Final = 0.3  # two cells; farther along a facade the motor's phase tells which cells are met
_BY_CHANCE: Final = 3.0  # standard deviations of a difference of two counts


def passes_by(source: SweepSource, grid: SensorGrid, on_sweep: Callable[[], None] | None = None) -> bool:
    """Whether most pairs of sweeps tell that the LiDAR moved between them."""
    return any(_most_shifted(source, grid, apart_s, on_sweep) for apart_s in _APART_S)


def _most_shifted(source: SweepSource, grid: SensorGrid, apart_s: float, on_sweep: Callable[[], None] | None) -> bool:
    count = len(source)
    if count < 2:
        return False
    step_s = max((stamp_of(source, count - 1) - stamp_of(source, 0)) * 1e-9 / (count - 1), 1e-3)
    gap = max(1, round(apart_s / step_s))
    firsts = spread(count - gap, _PAIRS)
    shifted = 0
    for first in firsts:
        before, other = (_upright(source.sweep(number), grid) for number in (first, first + gap))
        shifted += _shifted(before, other)
        if on_sweep is not None:
            on_sweep()
    return 2 * shifted > len(firsts)


def _upright(sweep: Sweep, grid: SensorGrid) -> Floats:
    """(N, 2) metres, level axes: points from which the next ring's surface rises more than it recedes.

    A neighbour on the same ring is near them.
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


def _shifted(image: Floats, other: Floats) -> bool:
    """Whether a shift lays the one on the other better than none does, to the left of its direction and to the right.

    A surface counts by the cells that it takes, not by its points: of a near car there are many.
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
    return all(_more(comes & ~stays & side, stays & ~comes & side) for side in (left, ~left))


def _more(gained: NDArray[np.bool_], lost: NDArray[np.bool_]) -> bool:
    """Whether more is gained than lost, and not by chance."""
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
    """How often one thing moves on as somebody walks, how often it jumps, and how far it gets between two jumps."""

    walks: int
    jumps: int
    way_m: float


def jumps(places: Sequence[Place]) -> bool:
    """Whether places of one thing jump more often than they move as somebody walks.

    Two places that no track joins tell neither. A place without which the others go on is another thing's.
    """
    runs = [[at for k, at in enumerate(run) if not _astray(run, k)] for run in _runs(places)]
    steps = [count_steps(run) for run in runs]
    return sum(part.jumps for part in steps) > sum(part.walks for part in steps)


def count_steps(places: Sequence[Place]) -> Steps:
    """The steps of one thing between places; where it stays counts as neither.

    Who walks goes on nearly as before; from pose to pose the next place has nothing to do with the one before.
    """
    walks = odd = 0
    start, way_m = next(iter(places), (0, 0.0, 0.0)), 0.0
    for before, at, after in zip(places, places[1:], places[2:], strict=False):
        if _odd(before, at, after):
            odd += 1
            start = after
            continue
        walks += not _stays(before, at, after)
        way_m = max(way_m, math.dist(start[1:], after[1:]))
    return Steps(walks, odd, way_m)


def _stays(before: Place, at: Place, after: Place) -> bool:
    return max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:])) < _STAYS_M


def _odd(before: Place, at: Place, after: Place) -> bool:
    """Whether nobody walks so."""
    step_s = max(at[0] - before[0], after[0] - at[0]) * 1e-9
    step_m = max(math.dist(before[1:], at[1:]), math.dist(at[1:], after[1:]))
    bend_m = math.hypot(*(after[k] - 2.0 * at[k] + before[k] for k in (1, 2)))
    too_far = step_m > _TREMBLE_M + _FASTEST_M_S * step_s
    too_bent = bend_m > _TREMBLE_M + _BRISKEST_M_S2 * step_s**2
    return not _stays(before, at, after) and (step_s > APART_S or too_far or too_bent)


def _runs(places: Sequence[Place]) -> list[list[Place]]:
    """Stretches of places that a track joins."""
    runs: list[list[Place]] = []
    for at in places:
        if not runs or at[0] - runs[-1][-1][0] > APART_S * 1e9:
            runs.append([])
        runs[-1].append(at)
    return runs


def _astray(run: Sequence[Place], k: int) -> bool:
    others = [*run[max(k - 2, 0) : k], *run[k + 1 : k + 3]]
    if not 0 < k < len(run) - 1 or len(others) < 3 or not _odd(*run[k - 1 : k + 2]):
        return False
    return not any(_odd(*three) for three in zip(others, others[1:], others[2:], strict=False))
