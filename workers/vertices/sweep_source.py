"""Sources of sweeps for detectors (recordings, lists, sensors without rings), and the area to look in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from workers.readers.recording import Sweep
from workers.vertices.vertex import Answers

OnSweep = Callable[[int], None]

_SAMPLES: Final = 4  # sweeps
_IN_CELL: Final = 4.0  # points; a cell and its neighbours are then empty once in 10,000 times by chance
_LEAST_CELL_RAD: Final = 2e-3
_CELL_STEP, _CELL_STEPS = 1.25, 20
_MOST_CELLS: Final = 256


class SweepSource(Protocol):
    """A recording's sweeps by number, 0 to len - 1; ``readers.normalised.SweepFile`` is one."""

    def __len__(self) -> int: ...

    def sweep(self, index: int) -> Sweep: ...


@runtime_checkable
class Stamped(Protocol):
    """A source that has all stamps without reading a sweep."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]: ...


def stamp_of(source: SweepSource, index: int) -> int:
    """Return the stamp of one sweep, UTC nanoseconds."""
    return int(source.stamps_ns[index]) if isinstance(source, Stamped) else source.sweep(index).stamp_ns


def spread(count: int, most: int) -> list[int]:
    """Return at most ``most`` of the numbers 0 to count - 1, evenly spread."""
    return sorted({int(n) for n in np.linspace(0, count - 1, min(most, count)).round()}) if count > 0 else []


class Listed:
    """Sweeps that are in memory, as a source."""

    def __init__(self, sweeps: Sequence[Sweep]) -> None:
        self._sweeps = sweeps

    def __len__(self) -> int:
        return len(self._sweeps)

    def sweep(self, index: int) -> Sweep:
        """The sweep of that number."""
        return self._sweeps[index]


def any_rings(source: SweepSource) -> bool:
    """Return whether the sensor has rings; without any, all points are of ring 0."""
    rings = (source.sweep(index).ring for index in spread(len(source), _SAMPLES))
    some = next((ring for ring in rings if len(ring)), np.ones(1))
    return bool(some.any())


class Scattered:
    """Sweeps of a sensor without rings, with cells of elevation as rings, as fine as its points are dense."""

    def __init__(self, source: SweepSource) -> None:
        self._source = source
        some = [_angles(source.sweep(index)) for index in spread(len(source), _SAMPLES)]
        elevation = np.concatenate([np.zeros(1), *(part[1] for part in some)])
        self._lowest = float(elevation.min())
        least = max(_LEAST_CELL_RAD, (float(elevation.max()) - self._lowest) / _MOST_CELLS)
        cells = least * _CELL_STEP ** np.arange(_CELL_STEPS)
        dense = (
            cell for cell in cells.tolist() if max((_in_cell(part, cell) for part in some), default=0) >= _IN_CELL
        )
        self._cell_rad = next(dense, float(cells[-1]))

    def __len__(self) -> int:
        return len(self._source)

    def sweep(self, index: int) -> Sweep:
        """The sweep of that number, by cells."""
        sweep = self._source.sweep(index)
        cell = (_angles(sweep)[1] - self._lowest) / self._cell_rad
        return replace(sweep, ring=np.clip(cell, 0, _MOST_CELLS - 1).astype(np.uint16))


def _angles(sweep: Sweep) -> NDArray[np.float64]:
    """Return (2, N) azimuth and elevation, radians."""
    x, y, z = np.nan_to_num(sweep.xyz.astype(np.float64)).T
    return np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])


def _in_cell(angles: NDArray[np.float64], cell_rad: float) -> float:
    """Return how many points share a cell with the median point."""
    if not angles.size:
        return 0.0
    _, cell, count = np.unique(np.floor(angles / cell_rad), axis=1, return_inverse=True, return_counts=True)
    return float(np.median(count[cell.ravel()]))


class Area(Protocol):
    """The points of a sweep that are looked at: a `region.Region` or a `static_background.Foreground`."""

    @property
    def fixed_left_out(self) -> bool:
        """Whether the static background is left out, so that what remains is carried or walks."""
        ...

    def inside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Return which points (N,) are looked at."""
        ...

    def outside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Return which points (N,) would be looked at, too, if the region were unlimited."""
        ...


# Looks for the apex in each sweep of a range.
Run = Callable[[SweepSource, Area, Options, range, OnSweep], Answers]
