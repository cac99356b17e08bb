# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
"""The static background: the returns that most sweeps of a recording have in common.

Sweeps are compared as images of ranges, one row per ring and one column per two firings. A return is the same in
another sweep if that has a return of about the same range in its cell or a neighbouring one. Without rings it is the
same if it lies on the surface through the nearest returns of the other sweep, no farther away than these lie apart.
A sweep in which something nearer hides the place does not count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Self

import numba as nb
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from workers.readers.recording import Sweep
from workers.vertices.region import Region
from workers.vertices.sensor_grid import learn_grid
from workers.vertices.sweep_source import Scattered, SweepSource, spread

Floats = NDArray[np.float64]
Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

MOST_COMPARED: Final = 48
_GRID_SWEEPS: Final = 8
_MOST_BYTES: Final = 128 * 1024**2  # both images of all sweeps; 48 sweeps of 128 rings at 0.1 degrees take 89 MB
_FIRINGS: Final = 2  # per cell, so that each cell has a return whatever the phase of the firings
_ACCURACY_M: Final = 0.03  # data sheets of spinning sensors
_DEVIATIONS: Final = 4.0  # of the difference of two ranges
_GRAZING_M: Final = 0.5  # returns of one cell that are farther apart lie on two surfaces
# Of the step over three cells. By chance a cell shows another part of an even slant, which bends it by half of the
# step at most; two surfaces that meet within a cell bend it by the whole.
_EVEN: Final = 0.5
_SAME_SHARE: Final = 0.5  # of the sweeps that can see the place
_SEEN_SHARE: Final = 0.25  # of all sweeps; a place seen less often may hold several boards by chance
FIXED_SHARE: Final = 0.75  # of a walk's sweeps that can see the place: nobody who walks stays so long
_BEHIND_SHARE: Final = 0.15
_SURFACE: Final = 7  # returns that determine the surface through one of them
_APART: Final = 2.0  # times the distance of these
_CLOUD: Final = 4000  # returns of a sweep without rings


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A sweep's N points compared with the other sweeps.

    Attributes:
        still: (N,) whether the point is the same in most sweeps that can see its place.
        moved: (N,) whether it is not, and other sweeps see something behind it: a surface, or nothing.
    """

    still: Mask
    moved: Mask


@dataclass(frozen=True, slots=True, eq=False)
class StaticBackground:
    """Images of some sweeps of a recording.

    Attributes:
        stamps_ns: of these sweeps.
        near, far: (S, R, C) least and greatest range in each cell, metres; 0 where there is no return.
        clouds: of sweeps without rings, instead of these.
        tolerance_m: greatest difference of two ranges of one surface.
    """

    stamps_ns: Sequence[int]
    near: Images
    far: Images
    tolerance_m: float
    clouds: Sequence[_Cloud] = ()

    @classmethod
    def of(cls, source: SweepSource, most: int = MOST_COMPARED, on_sweep: Callable[[], None] | None = None) -> Self:
        """Return the background of at most ``most`` sweeps, spread over a recording."""
        numbers = spread(len(source), most)
        if isinstance(source, Scattered):
            return cls._of_clouds([source.sweep(number) for number in numbers], on_sweep)
        grid = learn_grid(source.sweep(number) for number in numbers[:: max(1, len(numbers) // _GRID_SWEEPS)])
        rings = max(grid.elevation.size, 1)
        most_columns = _MOST_BYTES // (2 * 4 * max(len(numbers), 1) * rings)
        columns = min(math.ceil(2.0 * math.pi / (_FIRINGS * grid.step)), most_columns)
        shape = rings, max(8, columns)
        near, far = (np.zeros((len(numbers), *shape), np.float32) for _ in range(2))
        stamps_ns: list[int] = []
        for index, number in enumerate(numbers):
            sweep = source.sweep(number)
            stamps_ns.append(sweep.stamp_ns)
            _fill(sweep.xyz, sweep.ring, near[index], far[index])
            if on_sweep is not None:
                on_sweep()
        return cls(stamps_ns, near, far, _tolerance(near, far))

    @classmethod
    def _of_clouds(cls, sweeps: Sequence[Sweep], on_sweep: Callable[[], None] | None = None) -> Self:
        clouds: list[_Cloud] = []
        for sweep in sweeps:
            clouds.append(_Cloud.of(sweep.xyz))
            if on_sweep is not None:
                on_sweep()
        thick = np.concatenate([np.zeros(1), *(cloud.thick_m for cloud in clouds)])
        none = np.zeros((len(clouds), 0, 0), np.float32)
        tolerance_m = max(_ACCURACY_M, _DEVIATIONS * float(np.median(thick)))
        return cls([sweep.stamp_ns for sweep in sweeps], none, none, tolerance_m, clouds)

    def with_sweeps(self, sweeps: Sequence[Sweep]) -> Self:
        """Return the images of other sweeps of the recording, with the same tolerance."""
        if self.clouds:
            return replace(self._of_clouds(sweeps), tolerance_m=self.tolerance_m)
        near, far = (np.zeros((len(sweeps), *self.near.shape[1:]), np.float32) for _ in range(2))
        for index, sweep in enumerate(sweeps):
            _fill(sweep.xyz, sweep.ring, near[index], far[index])
        return replace(self, stamps_ns=[sweep.stamp_ns for sweep in sweeps], near=near, far=far)

    def thinned(self, most: int) -> Self:
        """Return the background with at most ``most`` of its sweeps, evenly spread: coarser and quicker."""
        if len(self.stamps_ns) <= most:
            return self
        places = spread(len(self.stamps_ns), most)
        stamps_ns = [self.stamps_ns[index] for index in places]
        clouds = [self.clouds[index] for index in places] if self.clouds else ()
        return replace(self, stamps_ns=stamps_ns, near=self.near[places], far=self.far[places], clouds=clouds)

    def compare(self, sweep: Sweep, chosen: Mask | None = None, share: float = _SAME_SHARE) -> Compared:
        """Return which points of a sweep are still and which moved; without another sweep none is either.

        Args:
            chosen: (N,) points to look at; all others are neither.
            share: of the sweeps that can see a still point's place.
        """
        chosen = np.ones(len(sweep.xyz), np.bool_) if chosen is None else chosen
        still, moved = np.zeros((2, len(chosen)), np.bool_)
        others = np.array(
            [index for index, stamp_ns in enumerate(self.stamps_ns) if stamp_ns != sweep.stamp_ns], np.int64
        )
        if not others.size:
            return Compared(still, moved)
        same, beyond, none = self._count_relations(sweep.xyz[chosen], sweep.ring[chosen], others)
        count = others.size
        still[chosen] = (same >= max(1.0, _SEEN_SHARE * count)) & (same >= share * (same + beyond + none))
        moved[chosen] = ~still[chosen] & (beyond + none >= max(1.0, _BEHIND_SHARE * count))
        return Compared(still, moved)

    def same(self, sweep: Sweep, chosen: Mask, index: int) -> float:
        """Return the share of a sweep's points ``chosen`` (N,) that are the same in the image at ``index``."""
        if not chosen.any():
            return 0.0
        same, _, _ = self._count_relations(sweep.xyz[chosen], sweep.ring[chosen], np.array([index], np.int64))
        return float(np.mean(same > 0))

    def _count_relations(
        self, xyz: NDArray[np.float32], ring: NDArray[np.uint16], others: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], ...]:
        """Return (N,) the numbers of other sweeps that show the same point, something beyond it, and nothing."""
        if not self.clouds:
            return _count_relations(xyz, ring, self.near, self.far, others, self.tolerance_m)
        relations = np.array([self.clouds[int(index)].relations(xyz, self.tolerance_m) for index in others])
        return tuple(np.count_nonzero(relations == relation, axis=0) for relation in range(3))


class _Cloud(NamedTuple):
    """A sweep without rings: its returns, and for each the surface through the nearest ones.

    Attributes:
        tree: of the returns.
        normal: (N, 3) of the surfaces.
        thick_m, apart_m: (N,) how far the nearest returns lie off the surface, and apart.
        towards: tree of the returns' directions.
        reach_m: (N,) ranges.
    """

    tree: KDTree
    normal: Floats
    thick_m: Floats
    apart_m: Floats
    towards: KDTree
    reach_m: Floats

    @classmethod
    def of(cls, points: NDArray[np.float32]) -> Self:
        reach = np.linalg.norm(points, axis=1)
        real = np.isfinite(reach) & (reach > 0.0)
        xyz = points[real][:: -(-np.count_nonzero(real) // _CLOUD) or 1].astype(np.float64)
        if not len(xyz):
            xyz = np.full((1, 3), 1e6)
        tree, reach = KDTree(xyz), np.linalg.norm(xyz, axis=1)
        count = min(_SURFACE, len(xyz))
        apart, nearest = tree.query(xyz, np.arange(1, count + 1))  # pyright: ignore[reportArgumentType]
        around = xyz[nearest] - xyz[nearest].mean(axis=1, keepdims=True)
        size, axes = np.linalg.eigh(np.einsum("nka,nkb->nab", around, around) / count)
        thick = np.sqrt(np.maximum(size[:, 0], 0.0))
        return cls(tree, axes[:, :, 0], thick, apart[:, -1], KDTree(xyz / reach[:, None]), reach)

    def relations(self, points: NDArray[np.float32], tolerance_m: float) -> NDArray[np.int64]:
        """Return the `_relation` of each point (N, 3)."""
        xyz = np.nan_to_num(points.astype(np.float64), nan=1e6)
        reach = np.maximum(np.linalg.norm(xyz, axis=1), 1e-6)
        distance, nearest = self.tree.query(xyz)
        off = np.abs(np.einsum("na,na->n", self.normal[nearest], xyz - self.tree.data[nearest]))
        same = (off <= tolerance_m + _APART * self.thick_m[nearest]) & (
            distance <= np.maximum(_APART * self.apart_m[nearest], tolerance_m)
        )
        relations = np.zeros(len(xyz), np.int64)
        (other,) = np.nonzero(~same)
        aside, along = self.towards.query(xyz[other] / reach[other, None])
        empty = aside > _APART * self.apart_m[along] / self.reach_m[along]
        relations[other] = np.where(empty, 2, np.where(self.reach_m[along] > reach[other], 1, 3))
        return relations


@dataclass(frozen=True, slots=True, eq=False)
class Foreground:
    """A region without the static background.

    Attributes:
        foreground: which of the points (N,) of a sweep that lie in the region are not static.
        fixed_left_out: see `sweep_source.Area`.
    """

    region: Region
    foreground: Callable[[Sweep, Mask], Mask]
    fixed_left_out: bool

    @classmethod
    def of(cls, region: Region, background: StaticBackground, share: float, fixed_left_out: bool = True) -> Self:
        """Return the region without the points that are the same in a share of the sweeps that see their place."""
        return cls(region, lambda sweep, of: of & ~background.compare(sweep, of, share).still, fixed_left_out)

    def inside(self, sweep: Sweep) -> Mask:
        """Return which points (N,) of a sweep lie in the region and are not static."""
        inside = self.region.mask(sweep.xyz)
        return self.foreground(sweep, inside) if inside.any() else inside

    def outside(self, sweep: Sweep) -> Mask:
        """Return which points (N,) would be looked at, too, if the region were unlimited."""
        return self.foreground(sweep, ~self.region.mask(sweep.xyz))


def _tolerance(near: Images, far: Images) -> float:
    """Return the tolerance from the differences of ranges between neighbouring sweeps; most cells are static."""
    alone = (near > 0.0) & (far - near < 0.05)
    apart = [np.abs(near[k + 1] - near[k])[alone[k] & alone[k + 1]].astype(np.float64) for k in range(len(near) - 1)]
    values = np.concatenate([np.zeros(0), *apart])
    values = values[values < 0.2]
    spread = 1.4826 * float(np.median(values)) if values.size else 0.0
    return max(_ACCURACY_M, _DEVIATIONS * spread)


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _cell(x: float, y: float, z: float, columns: int) -> tuple[int, float]:
    """Return column and range of a point; the range is 0 if it has no coordinates."""
    distance = math.sqrt(x * x + y * y + z * z)
    if not (math.isfinite(distance) and distance > 0.0):
        return 0, 0.0
    return int((math.atan2(y, x) / (2.0 * math.pi) + 0.5) * columns) % columns, distance


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _fill(xyz: NDArray[np.float32], ring: NDArray[np.uint16], near: Images, far: Images) -> None:
    rings, columns = near.shape
    for i in range(xyz.shape[0]):
        c, distance = _cell(xyz[i, 0], xyz[i, 1], xyz[i, 2], columns)
        r = ring[i]
        if distance > 0.0 and r < rings:
            near[r, c] = distance if near[r, c] == 0.0 else min(near[r, c], distance)
            far[r, c] = max(far[r, c], distance)


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _relation(near: Images, far: Images, r: int, c: int, distance: float, tolerance: float) -> int:
    """Return 0: the other sweep shows the same; 1: something beyond; 2: nothing; 3: something in front."""
    columns = near.shape[1]
    empty = True
    for dc in range(-1, 2):
        column = c + dc
        if column < 0:
            column += columns
        elif column >= columns:
            column -= columns
        low, high = near[r, column], far[r, column]
        if low == 0.0:
            continue
        empty = False
        wide = high - low
        if wide > _GRAZING_M:
            if abs(distance - low) <= tolerance or abs(distance - high) <= tolerance:
                return 0
        elif low - tolerance - wide <= distance <= high + tolerance + wide:
            return 0
    if _on_slant(near, far, r, c, distance, tolerance):
        return 0
    if empty:
        return 2
    return 1 if far[r, c] == 0.0 or far[r, c] > distance else 3


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _on_slant(near: Images, far: Images, r: int, c: int, distance: float, tolerance: float) -> bool:
    """Return whether the point lies on a surface that recedes evenly over three cells, as a wall seen at a slant.

    Its range in a cell depends on the phase of the firings. Two surfaces differ: their ranges step within one cell.
    """
    columns = near.shape[1]
    before, after = (c - 1) % columns, (c + 1) % columns
    if near[r, before] == 0.0 or near[r, c] == 0.0 or near[r, after] == 0.0:
        return False
    first, last = 0.5 * (near[r, before] + far[r, before]), 0.5 * (near[r, after] + far[r, after])
    recedes = abs(last - first)
    if abs(first + last - near[r, c] - far[r, c]) > _EVEN * recedes:
        return False
    for k in (before, c, after):
        if far[r, k] - near[r, k] > _EVEN * recedes:
            return False
    return min(first, last) - tolerance <= distance <= max(first, last) + tolerance


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _count_relations(
    xyz: NDArray[np.float32],
    ring: NDArray[np.uint16],
    near: Images,
    far: Images,
    others: NDArray[np.int64],
    tolerance: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return (N,) the numbers of other sweeps that show the same point, something beyond it, and nothing."""
    counts = np.zeros((3, xyz.shape[0]), np.int64)
    _, rings, columns = near.shape
    column, range_m = np.empty(xyz.shape[0], np.int64), np.empty(xyz.shape[0])
    for i in range(xyz.shape[0]):
        column[i], range_m[i] = _cell(xyz[i, 0], xyz[i, 1], xyz[i, 2], columns)
        if ring[i] >= rings:
            range_m[i] = 0.0
    # One image after the other: each of them fits into the processor's cache.
    for k in others:
        for i in range(xyz.shape[0]):
            if range_m[i] > 0.0:
                relation = _relation(near[k], far[k], ring[i], column[i], range_m[i], tolerance)
                if relation < 3:
                    counts[relation, i] += 1
    return counts[0], counts[1], counts[2]
