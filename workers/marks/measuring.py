"""Corners of many sights measured in their frames, each frame read once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Final

import numpy as np

from apexcal.documents.corners import CornerName
from workers.geometry.models import ModelName
from workers.marks.alternatives import Beside, look_beside, mixed
from workers.marks.clock import at_clock
from workers.marks.edges import HALF_WIDTHS_PX, CornerFit, EdgeRefusal, measure_corner
from workers.marks.outer_edges import changes_outside
from workers.marks.profiles import Curve
from workers.marks.sights import Floats, FrameSource, Lens, MountedLens, Sight

_STEP_M: Final = 1e-2
SHAPE_M: Final = 0.005  # shape and bending of a board, and the beam: what stated covariances of vertices lack
_DEVIATIONS: Final = 3.0

OnSight = Callable[[], None]
Measured = dict[CornerName, CornerFit | EdgeRefusal]
CornerKey = tuple[int, CornerName]
"""Index of a sight, and a corner."""


@dataclass(frozen=True, eq=False)
class MarkTask:
    """The frames and sights of one camera of a recording, and the corners to mark in them."""

    frames: FrameSource
    sights: Sequence[Sight]
    size: tuple[int, int]
    lens: Lens | None
    model: ModelName
    corners: Sequence[CornerName]
    on_sight: OnSight
    offset_s: float = 0.0

    def at(self, offset_s: float) -> MarkTask:
        """Return the task for a camera clock that is ``offset_s`` seconds ahead of the pairing's."""
        return replace(self, sights=at_clock(self.sights, offset_s - self.offset_s), offset_s=offset_s)


def measure(
    task: MarkTask,
    indices: Sequence[int],
    camera: MountedLens,
    corners: Sequence[CornerName],
    half_width: float,
    softness: float,
    *,
    outward_m: float = 0.0,
    changes: list[Floats] | None = None,
    besides: dict[CornerKey, Beside] | None = None,
) -> dict[int, Measured]:
    """Measure corners in the frames of the sights with these indices.

    Args:
        half_width: px, to either side of the projections; wider where the LiDAR's error is.
        outward_m: the camera sees the board's corners this far outside of those that the LiDAR sees.
        changes: the result of `changes_outside` for each measured corner is appended to it.
        besides: the result of `look_beside` for each measured corner is put into it.
    """
    measured: dict[int, Measured] = {}
    ordered = sorted(indices, key=lambda index: task.sights[index].frame)
    for frame, of_frame in groupby(ordered, key=lambda index: task.sights[index].frame):
        image = task.frames[frame]
        for index in of_frame:
            task.on_sight()
            sight = task.sights[index]
            measured[index] = {}
            for name in corners:
                ends = sight.neighbours(name) if name in sight.corners else None
                if ends is None:
                    continue
                away = sight.corners[name] - ends
                away = outward_m * away / np.linalg.norm(away, axis=1, keepdims=True)
                corner = sight.corners[name] + away.sum(axis=0)
                sides = (ends[0] + away[1], ends[1] + away[0])
                edges = (_edge(camera, corner, sides[0]), _edge(camera, corner, sides[1]))
                fit = measure_corner(image, edges, _half_width(half_width, sight, camera, corner), softness)
                measured[index][name] = fit
                if not isinstance(fit, CornerFit):
                    continue
                scales = np.array([_px_per_m(camera, corner, *pair) for pair in (sides, sides[::-1])])
                if changes is not None:
                    changes.append(changes_outside(image, edges, fit, scales))
                if besides is not None:
                    besides[index, name] = look_beside(image, edges, fit, scales.mean(axis=1))
    return measured


def _half_width(least: float, sight: Sight, camera: MountedLens, corner: Floats) -> float:
    """Within which the LiDAR's error lets the edges lie: one of `HALF_WIDTHS_PX`, ``least`` or wider."""
    at = camera.pixels(np.vstack([corner, corner + _STEP_M * np.eye(3)]))
    J = (at[1:] - at[0]).T / _STEP_M
    if not np.all(np.isfinite(J)):
        return least
    spread = J @ (sight.covariance + SHAPE_M**2 * np.eye(3)) @ J.T
    needed = max(least, _DEVIATIONS * float(np.sqrt(np.linalg.norm(spread, 2))))
    return min((wide for wide in HALF_WIDTHS_PX if wide >= needed), default=HALF_WIDTHS_PX[0])


def with_alternatives(measured: dict[int, Measured], besides: dict[CornerKey, Beside]) -> dict[int, Measured]:
    """Return the measured corners, with the mixture over its edges for each that was seen."""
    fits: dict[CornerKey, CornerFit] = {}
    for index, corners in measured.items():
        fits |= {(index, name): fit for name, fit in corners.items() if isinstance(fit, CornerFit)}
    mixtures: dict[int, Measured] = {index: dict(corners) for index, corners in measured.items()}
    for (index, name), fit in mixed(fits, besides).items():
        mixtures[index][name] = fit
    return mixtures


def _edge(camera: MountedLens, start: Floats, end: Floats) -> Curve:
    return lambda share: camera.pixels(start + share[:, None] * (end - start))


def _px_per_m(camera: MountedLens, corner: Floats, end: Floats, other: Floats) -> Floats:
    """Return (2,) pixels that a metre outward takes, across the edge from the corner to its end.

    The first value holds at the corner, the second at the end.
    """
    outward = (corner - other) * _STEP_M / np.linalg.norm(corner - other)
    pixels = camera.pixels(np.array([corner, end, corner + outward, end + outward]))
    along = (pixels[1] - pixels[0]) / max(float(np.hypot(*(pixels[1] - pixels[0]))), 1e-9)
    return np.abs((pixels[2:] - pixels[:2]) @ np.array([-along[1], along[0]])) / _STEP_M
