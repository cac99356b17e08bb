"""A spinning LiDAR: where each beam of a sweep ends, and when it was fired.

Rings are numbered by elevation, 0 the lowest. The sensor turns clockwise seen from above (azimuth
atan2(y, x) falls with time), and each point carries its own time, as a VLP-16's does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.simulation.scene import Scene
from workers.simulation.walker import (
    BOARD_EDGES_M,
    HEAD_RADIUS_M,
    LEG_APART_M,
    LEG_RADIUS_M,
    TORSO_RADIUS_M,
    Poses,
    Walk,
)

# Mean intensity of what a beam meets: nothing, ground, wall, pole, board, clothes.
_INTENSITY = np.array([0.0, 12.0, 45.0, 80.0, 190.0, 28.0])
_RANGE_STEP_M = 0.002  # the resolution of a VLP-16's range
_FIRING_S = 2.304e-6  # one laser after the other


@dataclass(frozen=True, slots=True)
class LidarModel:
    """A spinning sensor.

    Attributes:
        elevations_deg: of each ring, rising.
        step_deg: azimuth between two firings of one laser.
        rate_hz: turns per second.
        max_range_m: farther surfaces give no point.
    """

    name: str
    elevations_deg: tuple[float, ...]
    step_deg: float = 0.2
    rate_hz: float = 10.0
    max_range_m: float = 100.0


def _even(name: str, rings: int, lowest: float, highest: float) -> LidarModel:
    return LidarModel(name, tuple(np.linspace(lowest, highest, rings).tolist()))


SENSORS = {
    "vlp16": _even("vlp16", 16, -15.0, 15.0),
    "hdl32": _even("hdl32", 32, -30.67, 10.67),
    "os1-64": _even("os1-64", 64, -22.5, 22.5),
}


def with_rings(sensor: LidarModel, rings: int) -> LidarModel:
    """The sensor with another number of rings, spread evenly over its elevations."""
    lowest, highest = sensor.elevations_deg[0], sensor.elevations_deg[-1]
    even = _even(sensor.name, rings, lowest, highest)
    return LidarModel(sensor.name, even.elevations_deg, sensor.step_deg, sensor.rate_hz, sensor.max_range_m)


class Lidar:
    """Scans the scene with the walker in it, over a forward sector of +- ``sector_deg``."""

    def __init__(
        self, sensor: LidarModel, scene: Scene, walk: Walk, *, sector_deg: float, noise_m: float, seed: int
    ) -> None:
        self.sensor = sensor
        self._scene = scene
        self._walk = walk
        self._noise_m = noise_m
        self._seed = seed
        # One column less than fits: the grid starts by up to a step late, and a column takes its time.
        self._columns = int(2.0 * sector_deg / sensor.step_deg) - 1
        self._sector = math.radians(sector_deg)
        self._omega = 2.0 * math.pi * sensor.rate_hz  # radians per second
        rings = len(sensor.elevations_deg)
        half = (rings + 1) // 2
        ring = np.arange(rings)
        firing = np.where(ring < half, 2 * ring, 2 * (ring - half) + 1)  # interleaved, as the VLP-16 does
        self._delay_s = firing * min(_FIRING_S, math.radians(sensor.step_deg) / self._omega / rings)
        self._elevations = np.deg2rad(np.array(sensor.elevations_deg))

    def seconds_per_sector(self) -> float:
        """From a sweep's stamp to its last point."""
        return 2.0 * self._sector / self._omega

    def sweep(self, index: int, start_s: float, stamp_ns: int) -> Sweep:
        """The sweep whose first column is fired at ``start_s`` (seconds since the start of the walk).

        The azimuth grid starts anew in each sweep by a random part of a step, as a free-running motor's
        does. Depends on (seed, index) alone.
        """
        random = np.random.default_rng([self._seed, 2, index])
        step = math.radians(self.sensor.step_deg)
        column_s = (np.arange(self._columns, dtype=np.float64) + random.uniform()) * step / self._omega
        distance, surface = self._beams(column_s, self._walk.poses(start_s + column_s))
        noisy = distance + random.normal(0.0, self._noise_m, distance.shape)
        noisy = np.round(noisy / _RANGE_STEP_M) * _RANGE_STEP_M
        brightness = _INTENSITY[surface] * random.uniform(0.8, 1.2, distance.shape)
        column, ring = np.nonzero(distance <= self.sensor.max_range_m)
        after_s = column_s[column] + self._delay_s[ring]
        azimuth = self._sector - self._omega * after_s
        elevation = self._elevations[ring]
        direction = np.column_stack(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        return Sweep(
            stamp_ns=stamp_ns,
            xyz=(direction * noisy[column, ring][:, None]).astype(np.float32),
            intensity=brightness[column, ring].astype(np.float32),
            ring=ring.astype(np.uint16),
            offset_ns=np.round(after_s * 1e9).astype(np.int64),
        )

    def _beams(self, column_s: NDArray[np.float64], poses: Poses) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Range (C, R), infinite where nothing is met, and surface (C, R) of the beams of C columns."""
        scene = self._scene
        top = scene.ground_z + scene.wall_height
        return _cast(
            self._sector - self._omega * column_s,
            self._omega * self._delay_s,
            self._elevations,
            poses.apex,
            poses.edge_left,
            poses.edge_right,
            poses.body,
            poses.left,
            poses.height,
            np.array([scene.ground_z, scene.wall_x, scene.wall_half_width, top]),
            scene.poles,
        )

    def scan_seconds(self, azimuth: NDArray[np.float64]) -> NDArray[np.float64]:
        """Seconds after a sweep's start at which the sensor looks along ``azimuth`` (radians)."""
        return (self._sector - azimuth) / self._omega


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _cylinder(c: float, s: float, slope: float, x: float, y: float, radius: float, low: float, high: float) -> float:
    """Horizontal distance at which the ray (c, s) with ``slope`` meets an upright cylinder, else inf."""
    along = x * c + y * s
    across = x * s - y * c
    rest = radius * radius - across * across
    if along <= 0.0 or rest <= 0.0:
        return math.inf
    hit = along - math.sqrt(rest)
    z = hit * slope
    return hit if low <= z <= high else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _head(c: float, s: float, slope: float, x: float, y: float, z: float) -> float:
    """Horizontal distance to the sphere of the head, else inf."""
    norm = math.sqrt(1.0 + slope * slope)
    along = (x * c + y * s + z * slope) / norm
    rest = HEAD_RADIUS_M * HEAD_RADIUS_M - (x * x + y * y + z * z - along * along)
    return (along - math.sqrt(rest)) / norm if rest > 0.0 else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy", inline="always")
def _board(
    c: float,
    s: float,
    slope: float,
    apex: NDArray[np.float64],
    edge_left: NDArray[np.float64],
    edge_right: NDArray[np.float64],
) -> float:
    """Horizontal distance to the board, a rectangle with a corner at the apex, else inf."""
    n0 = edge_left[1] * edge_right[2] - edge_left[2] * edge_right[1]
    n1 = edge_left[2] * edge_right[0] - edge_left[0] * edge_right[2]
    n2 = edge_left[0] * edge_right[1] - edge_left[1] * edge_right[0]
    hit = (n0 * apex[0] + n1 * apex[1] + n2 * apex[2]) / (n0 * c + n1 * s + n2 * slope)
    d0, d1, d2 = hit * c - apex[0], hit * s - apex[1], hit * slope - apex[2]
    p = d0 * edge_left[0] + d1 * edge_left[1] + d2 * edge_left[2]
    q = d0 * edge_right[0] + d1 * edge_right[1] + d2 * edge_right[2]
    inside = 0.0 <= p <= BOARD_EDGES_M[0] and 0.0 <= q <= BOARD_EDGES_M[1]
    return hit if hit > 0.0 and inside else math.inf


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _walker(
    c: float,
    s: float,
    slope: float,
    apex: NDArray[np.float64],
    edge_left: NDArray[np.float64],
    edge_right: NDArray[np.float64],
    body: NDArray[np.float64],
    left: NDArray[np.float64],
    height: float,
    ground: float,
) -> tuple[float, float]:
    """Horizontal distances to the board and to the body, each inf where the ray misses it."""
    x, y = body[0], body[1]
    hip, shoulder = ground + 0.47 * height, ground + height - 2.4 * HEAD_RADIUS_M
    person = min(
        _cylinder(c, s, slope, x, y, TORSO_RADIUS_M, hip, shoulder),
        _head(c, s, slope, x, y, ground + height - HEAD_RADIUS_M),
    )
    for side in (-LEG_APART_M, LEG_APART_M):
        leg = _cylinder(c, s, slope, x + side * left[0], y + side * left[1], LEG_RADIUS_M, ground, hip)
        person = min(person, leg)
    return _board(c, s, slope, apex, edge_left, edge_right), person


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _static(
    c: float, s: float, slope: float, flat: NDArray[np.float64], poles: NDArray[np.float64]
) -> tuple[float, int]:
    """Horizontal distance to ground, wall or pole, and which of them."""
    ground, wall_x, wall_half_width, wall_top = flat[0], flat[1], flat[2], flat[3]
    hit = ground / slope if slope < 0.0 else math.inf
    surface = 1
    wall = wall_x / c
    if c > 0.0 and wall < hit and abs(wall * s) <= wall_half_width and wall * slope <= wall_top:
        hit, surface = wall, 2
    for i in range(poles.shape[0]):
        x, y, radius, high = poles[i, 0], poles[i, 1], poles[i, 2], poles[i, 3]
        pole = _cylinder(c, s, slope, x, y, radius, ground, ground + high)
        if pole < hit:
            hit, surface = pole, 3
    return hit, surface


@nb.njit(nogil=True, cache=True, error_model="numpy")
def _cast(
    azimuth: NDArray[np.float64],
    azimuth_delay: NDArray[np.float64],
    elevation: NDArray[np.float64],
    apex: NDArray[np.float64],
    edge_left: NDArray[np.float64],
    edge_right: NDArray[np.float64],
    body: NDArray[np.float64],
    left: NDArray[np.float64],
    height: NDArray[np.float64],
    flat: NDArray[np.float64],
    poles: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Range (C, R) and surface (C, R) of every beam; the walker stands still while one column fires."""
    columns, rings = azimuth.size, elevation.size
    distance = np.empty((columns, rings))
    surface = np.zeros((columns, rings), np.int64)
    for i in range(columns):
        for j in range(rings):
            angle = azimuth[i] - azimuth_delay[j]
            c, s, slope = math.cos(angle), math.sin(angle), math.tan(elevation[j])
            hit, what = _static(c, s, slope, flat, poles)
            if abs(body[i, 0] * s - body[i, 1] * c) < 1.5:
                board, person = _walker(
                    c, s, slope, apex[i], edge_left[i], edge_right[i], body[i], left[i], height[i], flat[0]
                )
                if person < hit:
                    hit, what = person, 5
                if board < hit:
                    hit, what = board, 4
            distance[i, j] = hit * math.sqrt(1.0 + slope * slope)
            surface[i, j] = what if hit < math.inf else 0
    return distance, surface
