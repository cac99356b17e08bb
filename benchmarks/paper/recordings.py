"""A simulated walk as two detectors see it, and a camera that films it by a clock of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import SimulationOptions
from workers.simulation.rig import START_NS, SimulatedRig
from workers.simulation.scene import WALKER_REGION
from workers.simulation.walker import BOARD_EDGES_M
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed
from workers.vertices.vertex import Vertex

Floats = NDArray[np.float64]

SWEEP_HZ: Final = 10
_FRAME_HZ: Final = 15.0
_CHUNK: Final = 500
_KEPT_SWEEPS: Final = 64
_REFINED: Final = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}
_AHEAD: Final = 1.3  # frames needed for a number of pairs, and a margin


@dataclass(frozen=True)
class Wanted:
    """One of the two recordings.

    Attributes:
        pairs: as many as the paper has of it.
        sweeps: as many as the paper has; refined vertices are looked for in these alone.
        most_sweeps: `strict` may look on until it has its pairs, to the end of the walk.
    """

    seed: int
    pairs: int
    sweeps: int
    most_sweeps: int


@dataclass(frozen=True, eq=False)
class Walked:
    """The walk of one recording and the vertices that each detector found in it."""

    wanted: Wanted
    vertices: dict[str, list[Vertex]]

    @cached_property
    def rig(self) -> SimulatedRig:
        return SimulatedRig(_settings(self.wanted))

    def apex(self, times_ns: NDArray[np.int64]) -> Floats:
        """(M, 3) where the apex truly was at moments of the LiDAR's clock."""
        return self.rig.walk.poses((times_ns - START_NS).astype(np.float64) * 1e-9).apex

    def frame_times_ns(self, repeat: int) -> NDArray[np.int64]:
        """When the camera took its frames, by the LiDAR's clock; each repeat begins at another phase."""
        phase = np.random.default_rng([self.wanted.seed, 21, repeat]).uniform(0.0, 1.0 / _FRAME_HZ)
        count = int((self.wanted.most_sweeps / SWEEP_HZ - 0.2) * _FRAME_HZ * 0.9987)
        return START_NS + np.round((phase + np.arange(count) / (_FRAME_HZ * 0.9987)) * 1e9).astype(np.int64)


def walk_and_detect(wanted: Wanted) -> Walked:
    """Simulate the walk sweep by sweep and run both detectors over it."""
    lazy = _Lazy(wanted)
    region = Region.from_document(WALKER_REGION)
    strict: list[Vertex] = []
    for first in range(0, wanted.most_sweeps, _CHUNK):
        if len(strict) >= _AHEAD * wanted.pairs:
            break
        chunk = [lazy.sweep(index) for index in range(first, min(first + _CHUNK, wanted.most_sweeps))]
        part = detect_range(Listed(chunk), region, "strict", indices=range(len(chunk))).vertices
        strict += [replace(vertex, sweep_index=vertex.sweep_index + first) for vertex in part]
    refined = detect_range(lazy, region, "refined", _REFINED, indices=range(len(lazy))).vertices
    return Walked(wanted, {"strict": strict, "refined": refined})


class _Lazy:
    """The paper's sweeps, simulated when they are asked for; the latest are kept."""

    def __init__(self, wanted: Wanted) -> None:
        self._count = wanted.sweeps
        self.sweep = lru_cache(_KEPT_SWEEPS)(SimulatedRig(_settings(wanted)).sweep)

    def __len__(self) -> int:
        return self._count


def _settings(wanted: Wanted) -> SimulationOptions:
    return SimulationOptions(seconds=wanted.most_sweeps / SWEEP_HZ, seed=wanted.seed, walk="cover")


def field_points(ground_z: float) -> Floats:
    """(M, 3) apexes all over the field of 10 x 30 m, as low and as high as arms carry them."""
    x, y, z = np.meshgrid(np.arange(4.0, 32.1, 1.0), np.arange(-5.0, 5.1, 0.5), np.arange(1.2, 2.5, 0.3))
    points = np.column_stack([x.ravel(), y.ravel(), ground_z + z.ravel()])
    return points[np.abs(points[:, 1]) < points[:, 0] * np.tan(np.deg2rad(50.0))]
