"""A road with lane markers, cars, buildings and poles, through which a vehicle drives.

World frame: x along the road, y left, z up, metres; the ground is z = 0. The vehicle looks along x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LIDAR_HEIGHT_M: Final = 1.9
_LENGTH_M: Final = 160.0
# Widths of lane lines and of bars of crosswalks; Vienna Convention on Road Signs and Signals, national ranges.
_LINE_M: Final = (0.10, 0.20)
_BAR_M: Final = (0.40, 0.60)
_LANE_M: Final = (2.8, 3.7)


@dataclass(frozen=True, slots=True)
class Road:
    """What stands and what is painted.

    Attributes:
        boxes: (B, 7) x0 x1 y0 y1 z0 z1, albedo 0 to 1.
        poles: (P, 5) x, y, radius, height, albedo.
        paint: (M, 5) rectangles x0 x1 y0 y1 on the ground, albedo.
        asphalt: albedo of the ground.
        sky: brightness 0 to 1.
        seed: of its surfaces' texture.
    """

    boxes: Floats
    poles: Floats
    paint: Floats
    asphalt: float
    sky: float
    seed: int


def draw_road(seed: int, *, is_empty: bool = False, is_painted: bool = True) -> Road:
    """A road drawn from wide ranges of lane widths, paint, cars, buildings and poles.

    is_empty: nothing stands beside it. is_painted: it has markers.
    """
    random = np.random.default_rng([seed, 21])
    none = np.zeros((0, 7))
    lane = random.uniform(*_LANE_M)
    return Road(
        boxes=none if is_empty else np.concatenate([_buildings(random, lane), _cars(random, lane)]),
        poles=none[:, :5] if is_empty else _poles(random, lane),
        paint=_paint(random, lane) if is_painted else none[:, :5],
        asphalt=random.uniform(0.12, 0.3),
        sky=random.uniform(0.6, 0.95),
        seed=seed,
    )


def _paint(random: np.random.Generator, lane: float) -> Floats:
    """Lines between lanes, dashed or not, at the edges, and a crosswalk or two."""
    albedo = random.uniform(0.55, 0.9)
    width = random.uniform(*_LINE_M)
    dash, gap = random.uniform(2.0, 5.0), random.uniform(3.0, 8.0)
    shift = random.uniform(-0.5, 0.5)
    rows: list[tuple[float, float, float, float, float]] = []
    for place in (-1.5, -0.5, 0.5, 1.5):
        y = place * lane + shift
        starts = [0.0] if abs(place) > 1.0 else list(np.arange(0.0, _LENGTH_M, dash + gap))
        length = _LENGTH_M if abs(place) > 1.0 else dash
        rows += [(x, x + length, y - width / 2, y + width / 2, albedo) for x in starts]
    for x in random.uniform(10.0, _LENGTH_M, 2):
        bar = random.uniform(*_BAR_M)
        ys = np.arange(-1.5 * lane, 1.5 * lane, 2.2 * bar)
        rows += [(x, x + 3.0, y, y + bar, albedo) for y in ys]
    return np.array(rows)


def _buildings(random: np.random.Generator, lane: float) -> Floats:
    rows: list[tuple[float, ...]] = []
    for side in (-1.0, 1.0):
        x = -10.0
        while x < _LENGTH_M + 40.0:
            length, deep = random.uniform(4.0, 18.0), random.uniform(3.0, 10.0)
            front = 1.5 * lane + random.uniform(3.0, 12.0)
            y0, y1 = sorted((side * front, side * (front + deep)))
            rows.append((x, x + length, y0, y1, 0.0, random.uniform(2.5, 15.0), random.uniform(0.15, 0.85)))
            x += length + random.uniform(0.5, 8.0)
    return np.array(rows)


def _cars(random: np.random.Generator, lane: float) -> Floats:
    rows: list[tuple[float, ...]] = []
    for _ in range(int(random.integers(8, 25))):
        x, side = random.uniform(6.0, _LENGTH_M + 30.0), random.choice((-1.0, 1.0))
        y = side * (1.5 * lane + random.uniform(0.6, 1.6))
        albedo, half, long = random.uniform(0.05, 0.9), random.uniform(0.8, 1.0), random.uniform(3.8, 5.0)
        rows.append((x, x + long, y - half, y + half, 0.25, 0.95, albedo))
        rows.append((x + 0.8, x + long - 0.6, y - half + 0.1, y + half - 0.1, 0.95, 1.5, 0.6 * albedo))
    return np.array(rows)


def _poles(random: np.random.Generator, lane: float) -> Floats:
    count = int(random.integers(8, 30))
    y = random.choice((-1.0, 1.0), count) * (1.5 * lane + random.uniform(1.7, 3.0, count))
    x, radius = random.uniform(0.0, _LENGTH_M + 30.0, count), random.uniform(0.05, 0.25, count)
    return np.column_stack([x, y, radius, random.uniform(2.0, 9.0, count), random.uniform(0.1, 0.9, count)])
