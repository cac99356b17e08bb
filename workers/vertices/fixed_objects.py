"""What stands still while somebody walks with the board: walls, cars and signs, which can be no board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.backdrop import Backdrop
from workers.vertices.region import Region
from workers.vertices.sweep_source import SweepSource, stamp_of

Mask = NDArray[np.bool_]

# The largest board is 1.8 m wide. Carried at 0.3 m/s, it has left its place after 6 s.
_LEAST_S: Final = 6.0
_COMPARED: Final = 16


@dataclass(frozen=True, slots=True, eq=False)
class WithoutFixed:
    """A region without the objects that stand still over a whole walk."""

    region: Region
    backdrop: Backdrop

    @property
    def fixed_left_out(self) -> bool:
        """See `sweep_source.Area`."""
        return True

    def inside(self, sweep: Sweep) -> Mask:
        """Which points (N,) of a sweep lie in the region and on nothing that stands still."""
        kept = self.region.mask(sweep.xyz)
        return kept & ~self.backdrop.fixed(sweep, kept) if kept.any() else kept


def without_fixed(
    source: SweepSource, region: Region, on_sweep: Callable[[], None] | None = None
) -> Region | WithoutFixed:
    """The region without fixed objects; as it is where the recording is too short to tell them."""
    count = len(source)
    if count < _COMPARED or stamp_of(source, count - 1) - stamp_of(source, 0) < _LEAST_S * 1e9:
        return region
    return WithoutFixed(region, Backdrop.of(source, _COMPARED, on_sweep))
