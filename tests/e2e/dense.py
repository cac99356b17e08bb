"""A recording of a few sweeps with as many points as large sensors have: a room of 40 x 24 m."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.workers.readers.making_recordings import (
    CLOUD,
    PERIOD_NS,
    START_NS,
    cloud,
    images,
    interleaved,
    png,
    scene,
    write_bag,
)

RINGS = 128
COLUMNS = (782, 782, 2344)  # 100,096, 100,096 and 300,032 points


def room(columns: int, noise: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Columns of one sweep; ``noise`` (N,) in metres along the ray."""
    points = scene(RINGS, columns)
    azimuth = np.arctan2(points["y"], points["x"])
    elevation = np.radians(-25 + 40 * points["ring"] / (RINGS - 1))
    walls = np.minimum(20 / np.maximum(np.abs(np.cos(azimuth)), 1e-6), 12 / np.maximum(np.abs(np.sin(azimuth)), 1e-6))
    floor = np.where(elevation < 0, 1.8 / np.maximum(np.sin(-elevation), 1e-6), 80)
    distance = np.minimum(walls / np.cos(elevation), floor) + noise
    level = distance * np.cos(elevation)
    return points | {"x": level * np.cos(azimuth), "y": level * np.sin(azimuth), "z": distance * np.sin(elevation)}


def write_dense(path: Path, width: int, height: int) -> Path:
    """The bag, with frames of a camera beside the sweeps."""
    rng = np.random.default_rng(1)
    stamps = [START_NS + number * PERIOD_NS for number in range(len(COLUMNS))]
    sweeps = [
        ("/points", CLOUD, stamp, cloud(stamp, room(columns, rng.normal(0, 0.015, RINGS * columns))))
        for stamp, columns in zip(stamps, COLUMNS, strict=True)
    ]
    return write_bag(path, interleaved(sweeps, images(len(COLUMNS), data=png(width, height))))
