"""Walks and streets whose sensor, scene, person and board are drawn (`tests.support.scenes.drawn`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.detection.figures import figures
from benchmarks.detection.walks import Found, found, looked_at
from tests.support.scenes.drawn import draw, draw_street
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

STREET_SWEEPS = 5
# A short recording gives no upper corner. In this one people walk away, and what stands still is told.
LEVEL_SWEEPS, LEVEL_PERIOD_S = 24, 0.3
_FEW = 20  # vertices of a walk, below which its bias says nothing


@dataclass(frozen=True, slots=True)
class DrawnWalk:
    """One drawn walk, and what was found in it."""

    seed: int
    found: Found


def run_drawn(asked: tuple[int, float, int]) -> DrawnWalk:
    """Simulate the drawn walk of a seed, so many seconds long, and look for its board, whose size is known.

    The third number is the detector's ``upper_corner``; if it is not 0, the board is held level but for a drawn roll.
    """
    seed, seconds, upper = asked
    drawn = draw(seed)
    if upper:
        off = float(np.clip(np.random.default_rng([seed, 79]).normal(0.0, 6.0), -15.0, 15.0))
        drawn = replace(drawn, hold=replace(drawn.hold, rolled_deg=45.0 * upper + off))
    walked = looked_at(*drawn.simulated(seconds), seconds)
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1], "upper_corner": upper}
    return DrawnWalk(seed, found(walked, Region.from_document(drawn.region()), "refined", size))


def drawn_figures(walks: Sequence[DrawnWalk]) -> dict[str, Any]:
    """All drawn walks together, and each by itself; ``worst_bias_deg`` is of azimuth and elevation."""
    each = [{"seed": walk.seed, **figures([walk.found])} for walk in walks]
    biases = [
        max(abs(walk["bias_deg"]), abs(walk["bias_azimuth_deg"])) for walk in each if walk.get("vertices", 0) >= _FEW
    ]
    rejected = sum((Counter(walk.found.rejected) for walk in walks), Counter[str]())
    return figures([walk.found for walk in walks]) | {
        "worst_bias_deg": max(biases, default=0.0),
        "walks_within_0.015_deg": float(np.mean([bias <= 0.015 for bias in biases])) if biases else 0.0,
        "rejected": dict(rejected),
        "each": each,
    }


def run_street(asked: tuple[int, int]) -> int:
    """How many sweeps of a drawn street without a board give a vertex.

    Args:
        asked: the seed, and the detector's ``upper_corner``. If that is not 0, the sweeps are `LEVEL_PERIOD_S` apart.
    """
    seed, upper = asked
    drawn = draw_street(seed)
    period_s, count = (LEVEL_PERIOD_S, LEVEL_SWEEPS) if upper else (1.0 / drawn.sensor.rate_hz, STREET_SWEEPS)
    _, lidar = drawn.simulated(period_s * count + 1.0 if upper else 1.0)
    sweeps = [lidar.sweep(k, k * period_s, round(k * period_s * 1e9)) for k in range(count)]
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1], "upper_corner": upper}
    region = Region.from_document(drawn.region())
    return len(detect_range(Listed(sweeps), region, "refined", size, indices=range(len(sweeps))).vertices)
