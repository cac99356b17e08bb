"""Still poses: how they are noticed, which sweeps show the same pose, and which points are not static.

A board that is shown in still poses jumps between sweeps farther than anybody walks. Sweeps that lie far apart in
time, or short recordings whose largest moving thing jumps, are taken as poses even if the owner did not say so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.motion import APART_S, count_steps
from workers.vertices.region import Region
from workers.vertices.sensor_grid import SensorGrid, some_grid
from workers.vertices.static_background import StaticBackground
from workers.vertices.suggested_region import things_of, upright_pieces
from workers.vertices.sweep_source import SweepSource, spread, stamp_of
from workers.vertices.vertex import PoseFacts

Mask = NDArray[np.bool_]

_NOTICED_UP_TO: Final = 64  # sweeps; who walks records more than six seconds
_FEWEST_OF_A_WALK: Final = 4
_FEWEST_JUMPS: Final = 8  # fewer may be a board that is split where sweeps begin
_SAME_POSE: Final = 0.9
_GRID_SWEEPS: Final = 8
_PAIRS: Final = 4
_A_SWEEP: Final = 500  # points; clouds with fewer were cut out already and show no surroundings
_LOOKED_AT: Final = 16
# Sweeps that the largest moving thing is looked for with. All points of a sweep are compared with them: among every
# k-th point, pieces of a facade have a person's size.
_MOST_IMAGES: Final = 12
_RUNS, _RUN_SWEEPS = 4, 6  # of neighbouring sweeps that distinguish a walk from poses
_BODY_M: Final = 0.5
_FEET_M: Final = 0.3
STANDS_M: Final = 0.2  # a person who stands and holds a board sways by less
_SWAYS: Final = 0.3  # a swaying body shows a tenth of itself at its edges


@dataclass(frozen=True, slots=True, eq=False)
class StillPoses:
    """A recording of still poses, before any board is looked for.

    Attributes:
        background: what its sweeps have in common; a single pose shows no background.
        first: for each sweep, the index of the first sweep of its pose.
        grid: the directions in which the sensor fires.
        stated: whether the owner said so; otherwise the sweeps showed it.
        single: whether there is only one pose.
        walked: the owner said so, but something in the recording walks.
    """

    background: StaticBackground
    first: tuple[int, ...]
    grid: SensorGrid
    stated: bool
    single: bool
    walked: bool

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(set(self.first))

    def facts(self) -> PoseFacts:
        """Return the facts for the owner."""
        return PoseFacts(self.count, self.stated, self.walked)

    def grouped(self, source: SweepSource, region: Region, on_sweep: Callable[[], None] | None = None) -> StillPoses:
        """Return the poses with consecutive sweeps joined that look like the first of them."""
        if self.single:
            return self
        first: list[int] = []
        before: Sweep | None = None  # the first of its pose: a chain of small steps may lead anywhere
        for number in range(len(source)):
            sweep = source.sweep(number)
            if on_sweep is not None:
                on_sweep()
            together = before is not None and _same_pose(before, sweep, region, self.background)
            first.append(first[-1] if together else number)
            before = before if together else sweep
        return replace(self, first=tuple(first))

    def pose_of(self, index: int) -> range:
        """Return the sweeps that show the same pose as sweep ``index``."""
        first = self.first[index]
        stop = index + 1
        while stop < len(self.first) and self.first[stop] == first:
            stop += 1
        return range(first, stop)

    def foreground(self, sweep: Sweep, chosen: Mask) -> Mask:
        """Return which of the points ``chosen`` (N,) are not static.

        In a single pose, walls and anything too large for a board with its bearer count as static.
        """
        if not self.single:
            return chosen & ~self.background.compare(sweep, chosen).still
        pieces = upright_pieces(sweep, chosen, self.grid)
        return np.logical_or.reduce(pieces) if pieces else chosen


def find_poses(
    source: SweepSource, region: Region | None = None, *, stated: bool, on_sweep: Callable[[], None] | None = None
) -> StillPoses | None:
    """Return the poses of a recording; None if it is no recording of still poses.

    Args:
        region: sweeps show the same pose if nothing in it moves from one to the next. Without a region each sweep is
            a pose of its own.
        stated: the owner says that it is one. Otherwise the sweeps must show it: they are far apart in time, or there
            are 64 at most and the thing that moves in them moves as nobody walks.
    """
    count = len(source)
    if not count:
        return None
    certain = stated or _far_apart(source)
    if not certain and (count > _NOTICED_UP_TO or max(len(source.sweep(n).xyz) for n in (0, count - 1)) < _A_SWEEP):
        return None
    background = StaticBackground.of(source, on_sweep=on_sweep)
    if not certain and not _noticed(source, background):
        return None
    grid = some_grid(source, _GRID_SWEEPS)
    single = _single(source, background)
    first = (0,) * count if single else tuple(range(count))
    walked = stated and not single and _walked(source, background)
    poses = StillPoses(background, first, grid, stated, single, walked)
    return poses if region is None else poses.grouped(source, region, on_sweep)


def _far_apart(source: SweepSource) -> bool:
    """Return whether some neighbouring sweeps lie farther apart in time than a track reaches."""
    count = len(source)
    firsts = spread(count - 1, _PAIRS)
    steps_ns = [stamp_of(source, n + 1) - stamp_of(source, n) for n in firsts]
    return bool(steps_ns) and min(steps_ns) > APART_S * 1e9


def _noticed(source: SweepSource, background: StaticBackground) -> bool:
    """Return whether the largest moving thing jumps from pose to pose, or nothing moves at all."""
    if len(source) < _FEWEST_OF_A_WALK:
        return True
    places = _places(source, background, range(len(source)))
    steps = count_steps(places)
    # Somebody may stand about between two jumps, or walk a little behind the stand.
    if steps.jumps >= _FEWEST_JUMPS and 2 * steps.jumps > len(places) - 2:
        return True
    # Nothing moves in a single pose. A slow walker hardly moves from sweep to sweep, but does over the recording.
    return steps.jumps >= steps.walks and steps.way_m < STANDS_M


def _walked(source: SweepSource, background: StaticBackground) -> bool:
    """Return whether the moving thing walks, by some runs of neighbouring sweeps spread over the recording."""
    starts = spread(max(len(source) - _RUN_SWEEPS, 0) + 1, _RUNS)
    runs = [range(start, min(start + _RUN_SWEEPS, len(source))) for start in starts]
    steps = [count_steps(_places(source, background, run)) for run in runs]
    walks, jumps = (sum(values) for values in ([step.walks for step in steps], [step.jumps for step in steps]))
    return walks > jumps and max(step.way_m for step in steps) >= STANDS_M


def _places(source: SweepSource, background: StaticBackground, numbers: range) -> list[tuple[int, float, float]]:
    """Return stamp, x and y of the largest moving thing in each of some sweeps."""
    places: list[tuple[int, float, float]] = []
    few = background.thinned(_MOST_IMAGES)
    for number in numbers:
        sweep = source.sweep(number)
        middle = _largest(sweep.xyz[few.compare(sweep).moved].astype(np.float64))
        if middle is not None:
            places.append((sweep.stamp_ns, *middle))
    return places


def _largest(xyz: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the middle of the largest thing of a person's size; None if there is none."""
    things = things_of(xyz)
    if not things:
        return None
    x, y = np.median(things[0].points[:, :2], axis=0).tolist()
    return x, y


def _same_pose(first: Sweep, other: Sweep, region: Region, background: StaticBackground) -> bool:
    """Return whether something in the region is not static, and is the same in both sweeps."""
    both = background.with_sweeps([first, other])
    for sweep, index in ((first, 1), (other, 0)):
        inside = region.mask(sweep.xyz)
        if both.same(sweep, inside & ~background.compare(sweep, inside).still, index) < _SAME_POSE:
            return False
    return True


def _single(source: SweepSource, background: StaticBackground) -> bool:
    """Return whether all sweeps are one pose: nothing differs, or only a little of a person who sways."""
    shares: list[float] = []
    for number in range(0, len(source), max(1, len(source) // _LOOKED_AT)):
        sweep = source.sweep(number)
        moved = background.compare(sweep).moved
        middle = _largest(sweep.xyz[moved].astype(np.float64))
        if middle is None:
            shares.append(0.0)
            continue
        beside = np.linalg.norm(sweep.xyz[:, :2] - np.array(middle), axis=1) < _BODY_M
        beside &= sweep.xyz[:, 2] > sweep.xyz[beside, 2].min() + _FEET_M
        shares.append(np.count_nonzero(moved & beside) / max(np.count_nonzero(beside), 1))
    return float(np.median(shares)) < _SWAYS
