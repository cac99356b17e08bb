"""A sensor that hangs upside down, as the ground tells; its sweeps as if it stood, turned by half a turn about x."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from workers.readers.recording import Sweep
from workers.vertices.sensor_grid import SensorGrid, learn_grid
from workers.vertices.suggested_region import Suggestion
from workers.vertices.sweep_source import SweepSource

_GRID_SWEEPS: Final = 4
_TURN: Final = np.array([1.0, -1.0, -1.0], np.float32)


def some_grid(source: SweepSource) -> SensorGrid:
    """The grid of a sensor as a few of its sweeps tell."""
    numbers = sorted({int(n) for n in np.linspace(0, len(source) - 1, min(_GRID_SWEEPS, len(source))).round()})
    return learn_grid(source.sweep(number) for number in numbers)


def hangs(grid: SensorGrid) -> bool:
    """Whether the sensor hangs upside down."""
    return bool(grid.R_level_lidar[2, 2] < 0.0)


def hanging(source: SweepSource) -> SensorGrid | None:
    """The grid of a sensor that hangs upside down; None for any other."""
    grid = some_grid(source)
    return grid if hangs(grid) else None


class Turned:
    """The sweeps of a sensor that hangs, turned: z up, and the highest ring has the highest number."""

    def __init__(self, source: SweepSource, grid: SensorGrid) -> None:
        self._source = source
        self._top = max(grid.elevation.size - 1, 0)

    def __len__(self) -> int:
        return len(self._source)

    def sweep(self, index: int) -> Sweep:
        """The sweep of that number."""
        upright = self._source.sweep(index)
        ring = np.maximum(self._top - upright.ring.astype(np.int64), 0).astype(upright.ring.dtype)
        return replace(upright, xyz=upright.xyz * _TURN, ring=ring)


def turned_back(suggestion: Suggestion) -> Suggestion:
    """A region that was suggested in the turned sweeps, for the sweeps as they are."""
    if "level" in suggestion.document:
        return Suggestion(_turned_back(suggestion.document), suggestion.facts)
    facts = suggestion.facts | {"ground_z": -suggestion.facts["ground_z"]}
    facts |= {"z_low": -suggestion.facts["z_high"], "z_high": -suggestion.facts["z_low"]}
    return Suggestion(_turned_back(suggestion.document), facts)


def _turned_back(document: dict[str, Any]) -> dict[str, Any]:
    """Of the forms that suggestions have."""
    if "level" in document:
        # Half a turn about x leaves the level axes' x where it is: points have the same level coordinates.
        x, y, z = document["up"]
        return {"level": document["level"], "up": [x, -y, -z]}
    if "and" in document:
        return {"and": [_turned_back(part) for part in document["and"]]}
    if "not" in document:
        return {"not": _turned_back(document["not"])}
    if "box" in document:
        (x, y, z), (far_x, far_y, far_z) = document["box"]["min"], document["box"]["max"]
        return {"box": {"min": [x, -far_y, -far_z], "max": [far_x, -y, -z]}}
    low, high = document["z"]
    return {"polygon": [[x, -y] for x, y in document["polygon"]], "z": [-high, -low]}
