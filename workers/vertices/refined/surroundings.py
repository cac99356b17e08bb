"""What stands around the board in its sweep, and when the sensor looked at the apex."""

from __future__ import annotations

import math

import numpy as np

from workers.readers.recording import Sweep
from workers.vertices.refined.board_model import BoardModel, Fix, Floats, Sighting

_HEAD_BESIDE_M = 0.35
_HEAD_BEHIND_M = (-0.15, 0.7)
_IN_FRONT_M = 0.15
_BOARD_BESIDE_M, _BOARD_ABOVE_M, _BOARD_BEFORE_M, _BOARD_POINTS = 0.5, 1.5, -0.8, 2
_OCCLUDED_RINGS = 0.25
# Spinning sensors' data sheets state ranges to 0.03 m, and to 0.1 m where a return is unusually strong or weak.
_ACCURACY_M = 0.1
_EDGES = 2.0


def apex_time(sweep: Sweep, sighting: Sighting, fix: Fix) -> int:
    """Nanoseconds after the sweep's stamp at which the sensor looked along the apex's azimuth."""
    window, ends = sighting.window, sighting.ends
    runs = [(r, slice(first, last + 1)) for r, (first, last) in enumerate(ends.tolist()) if first >= 0]
    point = np.concatenate([window.point[run] for run in runs])
    azimuth = np.concatenate([window.azimuth[run] for run in runs])[point >= 0]
    offset = sweep.offset_ns[point[point >= 0]].astype(np.float64)
    apex = window.R_window_lidar @ fix.xyz
    towards = math.atan2(apex[1], apex[0])
    away = azimuth - azimuth.mean()
    spread = float(away @ away)
    rate = float(away @ offset) / spread if spread > 0.0 else 0.0
    return round(float(offset.mean()) + rate * (towards - float(azimuth.mean())))


def flags_of(sighting: Sighting, fix: Fix) -> tuple[str, ...]:
    """Names in ``vertex.FLAGS`` of what the person who confirms should look at."""
    behind, left, up = _around_apex(sighting, fix)
    returned = sighting.window.distance > 0.0
    over = returned & sighting.window.inside & (up > 0.0) & (np.abs(left) < _HEAD_BESIDE_M)
    over &= (behind > _HEAD_BEHIND_M[0]) & (behind < _HEAD_BEHIND_M[1])
    head = bool(over.any())
    hidden, rings = 0, 0
    for r, (first, last) in enumerate(sighting.ends.tolist()):
        if first >= 0:
            rings += 1
            beside = [c for c in (first - 1, first - 2, last + 1, last + 2) if 0 <= c < behind.shape[1]]
            hidden += any(returned[r, c] and behind[r, c] < -_IN_FRONT_M for c in beside)
    occluded = hidden > _OCCLUDED_RINGS * rings
    return (*(["head_above"] if head else []), *(["occluded"] if occluded else []))


def overtopped(sighting: Sighting, fix: Fix, model: BoardModel) -> bool:
    """Whether something stands above the apex and before the plane: then the plane is the body's, below a board."""
    behind, left, up = _around_apex(sighting, fix)
    over = (sighting.window.distance > 0.0) & sighting.window.inside & (np.abs(left) < _BOARD_BESIDE_M)
    # The beams that graze the board's own edges return from above its apex, and from before its plane.
    beside = _EDGES * (model.growth + model.soft) * sighting.plane.reach.mean()
    over &= (up > beside) & (up < _BOARD_ABOVE_M)
    # On a few rings the plane may be the body's, close behind a board: nothing but the noise can be allowed for.
    unusual = _ACCURACY_M if sighting.plane.telling else 0.0
    over &= (behind > _BOARD_BEFORE_M) & (behind < -unusual - 4.0 * model.sigma)
    return int(np.count_nonzero(over)) >= _BOARD_POINTS


def _around_apex(sighting: Sighting, fix: Fix) -> tuple[Floats, Floats, Floats]:
    """(R, C) metres: how far each return lies behind the plane, and how far its ray left of and above the apex."""
    window, w = sighting.window, sighting.plane.w
    inverse = w[0] * np.cos(window.azimuth) + w[1] * np.sin(window.azimuth) + w[2] * window.slope
    distance = 1.0 / np.maximum(inverse, 1e-3)
    apex = window.R_window_lidar @ fix.xyz
    left = distance * np.sin(window.azimuth - math.atan2(apex[1], apex[0]))
    return window.distance - distance, left, distance * window.slope - apex[2]
