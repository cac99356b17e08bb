"""Simulated walks with what is true of every sweep, and what the detectors find in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import DETECTORS
from tests.support.scenes.flawed_lidar import FlawedLidar
from tests.support.scenes.held_board import HeldWalk
from workers.readers.recording import Sweep
from workers.simulation.beams import BOARD
from workers.simulation.lidar import Walks
from workers.simulation.scene import WALKER_REGION, Scene
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import BOARD_EDGES_M
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

_START_NS = 1_780_000_000_000_000_000
_SECTOR_DEG = 60.0
_NOISE_M = 0.008
SIZE = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}


@dataclass(frozen=True, slots=True, eq=False)
class Walked:
    """A simulated walk.

    Attributes:
        apexes: (S, 3) the apex when the sensor looked at it, metres, in its frame.
        rings: (S,) how many rings meet the board.
        apex_at: the apex at a moment, nanoseconds; metres, in the sensor's frame.
    """

    sweeps: list[Sweep]
    apexes: NDArray[np.float64]
    rings: NDArray[np.int64]
    apex_at: Callable[[int], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Found:
    """What one detector found in one walk.

    Attributes:
        visible: (M,) ranges of the apex in the sweeps in which two rings or more meet the board, metres.
        vertices: (N, 8) azimuth, elevation (degrees) and range error (m) at the moment that the vertex states; their
            stated standard deviations; true range; whether two rings meet the board.
        rejected: how many sweeps were refused for which reason.
    """

    visible: NDArray[np.float64]
    vertices: NDArray[np.float64]
    rejected: Mapping[str, int]


def found(walked: Walked, region: Region, detector: str, options: Mapping[str, float]) -> Found:
    """What a detector finds in a walk."""
    reach = np.linalg.norm(walked.apexes, axis=1)
    detected = detect_range(Listed(walked.sweeps), region, detector, options, indices=range(len(walked.sweeps)))
    rows = [
        [
            *(_angles(np.array(vertex.xyz)) - _angles(walked.apex_at(vertex.time_ns))),
            *_stated(vertex.covariance),
            reach[vertex.sweep_index],
            float(walked.rings[vertex.sweep_index] >= 2),
        ]
        for vertex in detected.vertices
    ]
    return Found(reach[walked.rings >= 2], np.array(rows).reshape(-1, 8), detected.rejected)


def run_plain(asked: tuple[int, float]) -> dict[str, Found]:
    """What each detector finds in a plain walk: its seed, and its seconds. `refined` knows the board's size."""
    walked, region = simulate(*asked), Region.from_document(WALKER_REGION)
    return {name: found(walked, region, name, SIZE if name == "refined" else {}) for name in DETECTORS}


def simulate(seed: int, seconds: float) -> Walked:
    """A plain walk before a VLP-16: all over the field, the board upright, nothing in the way."""
    scene = Scene()
    walk = HeldWalk(seed, seconds, scene.ground_z, plan="field")
    lidar = FlawedLidar(SENSORS["vlp16"], scene, walk, sector_deg=_SECTOR_DEG, noise_m=_NOISE_M, seed=seed)
    return looked_at(walk, lidar, seconds)


def looked_at(walk: Walks, lidar: FlawedLidar, seconds: float) -> Walked:
    """The sweeps of a sensor that looks at a walk for so long."""
    sweeps: list[Sweep] = []
    apexes: list[NDArray[np.float64]] = []
    rings: list[int] = []
    for index in range(round(seconds * lidar.sensor.rate_hz)):
        start_s = index / lidar.sensor.rate_hz
        sweep, surface = lidar.labelled_sweep(index, start_s, _START_NS + round(start_s * 1e9))
        apex = lidar.in_sensor_frame(walk.poses(np.array([start_s])).apex)[0]
        for _ in range(3):  # the apex moves while the sensor turns towards it
            looked_s = start_s + float(lidar.scan_seconds(np.arctan2(apex[1], apex[0])))
            apex = lidar.in_sensor_frame(walk.poses(np.array([looked_s])).apex)[0]
        sweeps.append(sweep)
        apexes.append(apex)
        rings.append(np.unique(sweep.ring[surface == BOARD]).size)

    def apex_at(time_ns: int) -> NDArray[np.float64]:
        return lidar.in_sensor_frame(walk.poses(np.array([(time_ns - _START_NS) * 1e-9])).apex)[0]

    return Walked(sweeps, np.array(apexes), np.array(rings), apex_at)


def _angles(xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = xyz.tolist()
    flat = math.hypot(x, y)
    return np.array([math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, flat)), math.hypot(flat, z)])


def _stated(covariance: tuple[tuple[float, float, float], ...] | None) -> list[float]:
    if covariance is None:
        return [math.nan] * 3
    azimuth, elevation, reach = (math.sqrt(covariance[k][k]) for k in range(3))
    return [math.degrees(azimuth), math.degrees(elevation), reach]
