"""Where detectors read sweeps from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from workers.readers.recording import Sweep
from workers.vertices.vertex import Answers

OnSweep = Callable[[int], None]


class SweepSource(Protocol):
    """A recording's sweeps by number, 0 to len - 1; ``readers.normalised.LidarFile`` is one."""

    def __len__(self) -> int: ...

    def sweep(self, index: int) -> Sweep: ...


@runtime_checkable
class Stamped(Protocol):
    """A source that knows all stamps without reading a sweep."""

    @property
    def stamps_ns(self) -> NDArray[np.int64]: ...


def stamp_of(source: SweepSource, index: int) -> int:
    """The stamp of one sweep, UTC nanoseconds."""
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


class Area(Protocol):
    """Which points of a sweep are looked at: a `region.Region`, or what of it does not stand still."""

    @property
    def fixed_left_out(self) -> bool:
        """Whether what stands still over the recording is left out, so that what remains is carried or walks."""
        ...

    def inside(self, sweep: Sweep) -> NDArray[np.bool_]: ...

    def outside(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Which points (N,) would be looked at too if the region were everywhere."""
        ...


# Looks for the apex in each sweep of a range.
Run = Callable[[SweepSource, Area, Options, range, OnSweep], Answers]
