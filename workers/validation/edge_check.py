"""Depth edges of a drive compared with its frames: the score, its curves, and where it would be highest.

The score is the mean image gradient across the edges over the gradients nearby. The idea is that of Levinson and
Thrun (Automatic online calibration of cameras and lasers, 2013); edges between rings and against nothing are added,
because without them no pitch shows.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.validations import AxisCheck
from workers.readers.recording import Sweep
from workers.validation.calibration import KnownCalibration
from workers.validation.depth_edges import depth_edges
from workers.validation.edge_image import edge_image
from workers.validation.offsets import (
    MOST_GROUPS,
    ImageParts,
    curve_offsets,
    find_peak,
    find_roll,
    look_up,
    total,
    turn_grid,
)
from workers.validation.road_verdict import ScoredDrive, judge, judge_axes

Floats = NDArray[np.float64]
_ONE_DEGREE: Final = np.radians([[0.0, 1.0, 0, 0, 0, 0], [0.0, -1.0, 0, 0, 0, 0]])
# Cells of the image, and how much nearer than an edge something in its cell must be to hide it from the camera.
_CELLS: Final = 24
_NEARER: Final = 1.3
# Regions of the image that take turns among the groups.
_REGIONS: Final = (10, 6)


class EdgeCheck:
    """Collects frames one by one; `result` says what they show together."""

    widest_px: Final = 1024
    """Frames that are wider are made smaller: a pixel is a tenth of a degree there, as far as columns are apart."""

    def __init__(self, calibration: KnownCalibration) -> None:
        self.calibration = calibration
        self._turns = turn_grid()
        along, self._curves = curve_offsets()
        self._along = np.concatenate([along, np.zeros((1, 6)), _ONE_DEGREE])
        self._over_turns = np.zeros((2, len(self._turns), MOST_GROUPS))
        self._over_axes = np.zeros((2, len(self._along), MOST_GROUPS))
        self._frames = self._parts = 0

    def add(self, sweep: Sweep, image: NDArray[np.uint8]) -> None:
        """A sweep and the frame (h, w), grey, of its moment, possibly made smaller."""
        self._frames += 1
        parts = self._seen(sweep)
        self._parts += len(parts.pixels)
        if not len(parts.pixels):
            return
        scale = image.shape[1] / self.calibration.image_size[0]
        maps = edge_image(image)
        look_up(maps, scale, *parts, self._turns, *self._over_turns)
        look_up(maps, scale, *parts, self._along, *self._over_axes)

    def _seen(self, sweep: Sweep) -> ImageParts:
        """The edges that the camera sees, in groups by their place in the image."""
        edges = depth_edges(sweep)
        pixels, is_visible = self.calibration.project(edges.points)
        beyond = self.calibration.project(edges.beyond)[0]
        is_visible &= np.isfinite(beyond).all(axis=1)
        is_visible[is_visible] = ~self._hidden(sweep, edges.points[is_visible], pixels[is_visible])
        pixels, points = pixels[is_visible], edges.points[is_visible]
        across = np.abs(beyond[is_visible] - pixels)
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
        cell = pixels / self.calibration.image_size * _REGIONS
        column, row = np.clip(cell.astype(np.int64), 0, np.array(_REGIONS) - 1).T
        group = (row * _REGIONS[0] + column) % MOST_GROUPS
        return ImageParts(pixels, self.calibration.jacobians(points)[0], across, group)

    def _hidden(self, sweep: Sweep, points: Floats, pixels: Floats) -> NDArray[np.bool_]:
        """Which points something nearer may hide from the camera, which stands elsewhere than the LiDAR."""
        every = sweep.xyz.astype(np.float64)
        where, is_visible = self.calibration.project(every)
        size = self.calibration.image_size[0] / _CELLS
        rows = int(self.calibration.image_size[1] / size) + 2

        def cell(pixels: Floats) -> NDArray[np.int64]:
            column, row = np.floor((pixels + 0.5) / size).astype(np.int64).T
            return (row + 1) * (_CELLS + 2) + column + 1

        nearest = np.full((rows + 1) * (_CELLS + 2), np.inf)
        depth = self.calibration.mount.apply(every[is_visible])[:, 2]
        np.minimum.at(nearest, cell(where[is_visible]), depth)
        own = self.calibration.mount.apply(points)[:, 2]
        return own > _NEARER * nearest[cell(pixels)]

    @property
    def _watched(self) -> ScoredDrive:
        score = total(*self._over_axes)
        peak = find_peak(self._turns, *self._over_turns)
        at_zero, at_one = float(score[-3]), float(score[-2:].max())
        return ScoredDrive("depth edges", self._frames, self._parts, self._parts, at_zero, at_one, peak)

    @property
    def score(self) -> float:
        """That of the calibration as it is."""
        return self._watched.score

    def axes(self) -> list[AxisCheck]:
        """What the frames say of each turn of the mount."""
        roll = np.array(self._curves[2]["at"])
        rows = slice(2 * len(roll), 3 * len(roll))
        groups = int(np.count_nonzero(self._over_turns[1].sum(axis=0)))
        return judge_axes(self._watched, find_roll(roll, *self._over_axes[:, rows]), groups)

    def result(self) -> dict[str, Any]:
        """As the document of a road score says."""
        score = total(*self._over_axes)
        start = 0
        for curve in self._curves:
            curve["score"] = np.round(score[start : start + len(curve["at"])], 4).tolist()
            start += len(curve["at"])
        return judge(self._watched) | {"chance": 1.0, "curves": self._curves}
