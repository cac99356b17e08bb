"""Estimate the camera's clock offset beyond the pairing's, from a board that moves.

A mount that fits at a wrong clock leaves residuals along each corner's way in the image: they turn round where the
walker does. The mount is fitted at each of many offsets, and the best of them is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from workers.marks.mount_fit import fit_mount
from workers.marks.sights import Floats, Lens, MountedLens, Sight

COARSE_S: Final = (0.0, -0.025, 0.025, -0.05, 0.05)
"""A walker of 1.5 m/s comes 19 mm far in half a step: less than seeds are off, 15 px, nearer than 2 m."""
_SLOWEST_M_S: Final = 0.2  # boards on stands are slower; most of a walk is faster
_REACH_S: Final = 0.06  # more than the coarse offsets
_STEP_S: Final = 0.005
_SURE: Final = 3.0  # standard deviations; smaller offsets are none


class ClockShift(NamedTuple):
    """Camera clock minus that of the pairing, and its standard deviation, seconds."""

    offset_s: float
    sigma_s: float

    @property
    def is_sure(self) -> bool:
        """Whether the clocks do differ."""
        return abs(self.offset_s) > _SURE * self.sigma_s


def is_walk(sights: Sequence[Sight]) -> bool:
    """Whether the board moves in most of the sights."""
    return float(np.median([np.linalg.norm(sight.velocity) for sight in sights])) > _SLOWEST_M_S


def at_clock(sights: Sequence[Sight], offset_s: float) -> list[Sight]:
    """The sights at the frames' moments if the camera's clock is so far ahead."""
    if offset_s == 0.0:
        return list(sights)
    return [
        replace(sight, corners={name: xyz - offset_s * sight.velocity for name, xyz in sight.corners.items()})
        for sight in sights
    ]


def fit_clock(
    camera: MountedLens,
    lens: Lens | None,
    points: Floats,
    velocities: Floats,
    pixels: Floats,
    size: tuple[int, int],
    tolerance_px: float,
) -> ClockShift | None:
    """The offset at which a mount fits pixels (N, 2) of points (N, 3) with velocities (N, 3) best; None: not told.

    Args:
        tolerance_px: pixels much farther from their point count no more.
    """
    offsets: Floats = np.arange(-_REACH_S, _REACH_S + 0.5 * _STEP_S, _STEP_S, dtype=np.float64)
    weights = np.ones(len(points))
    costs: list[float] = []
    for offset in offsets.tolist():
        at = points - offset * velocities
        square = np.sum((fit_mount(camera, lens, at, pixels, weights, size).pixels(at) - pixels) ** 2, axis=1)
        square = np.where(np.isfinite(square), square, np.inf)
        costs.append(float(np.sum(1.0 - 1.0 / (1.0 + square / tolerance_px**2))))
    best = int(np.argmin(costs))
    if not 0 < best < len(offsets) - 1:
        return None
    left, middle, right = costs[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    # Each mark's cost has its own variance about the least, whatever the marks' noise is.
    noise = middle / max(len(points) - 1.0, 1.0)
    return ClockShift(
        float(offsets[best] + 0.5 * _STEP_S * (left - right) / max(bend, 1e-12)),
        float(_STEP_S * np.sqrt(2.0 * noise / max(bend, 1e-12))),
    )
