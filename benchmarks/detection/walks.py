"""Simulated walks with what is true of every sweep, and what the detectors find in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import Disturbances
from tests.support.scenes.drawn import region_before
from tests.support.scenes.flawed_lidar import FlawedLidar, Mount
from tests.support.scenes.held_board import BoardHold, HeldWalk
from workers.readers.recording import Sweep
from workers.simulation.beams import BOARD
from workers.simulation.lidar import Walks
from workers.simulation.scene import WALKER_REGION, Scene, scene_with
from workers.simulation.sensors import SENSORS, LidarModel
from workers.simulation.walker import BOARD_EDGES_M
from workers.simulation.walks import FIELD_X_M
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

_START_NS = 1_780_000_000_000_000_000
_SECTOR_DEG = 60.0
SIZE = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}
FOUR_RINGS = LidarModel("four rings", (-3.0, -1.0, 1.0, 3.0))


@dataclass(frozen=True, slots=True)
class Case:
    """What is simulated, and what looks at it.

    Attributes:
        detectors: key in the output -> detector and options.
        noise_m: of a range.
    """

    name: str
    detectors: Mapping[str, tuple[str, Mapping[str, float]]]
    disturbances: Disturbances = field(default_factory=Disturbances)
    noise_m: float = 0.008
    sensor: LidarModel = SENSORS["vlp16"]
    mount: Mount = field(default_factory=Mount)
    hold: BoardHold = field(default_factory=BoardHold)


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
        vertices: (N, 10) azimuth, elevation (degrees) and range error (m) at the moment that the vertex states; their
            stated standard deviations; true range; whether two rings meet the board; whether graded fine; whether
            flagged.
        rejected: how many sweeps were refused for which reason.
    """

    case: str
    key: str
    visible: NDArray[np.float64]
    vertices: NDArray[np.float64]
    rejected: Mapping[str, int]


def run(asked: tuple[Case, int, float]) -> list[Found]:
    """Simulate one walk of a case from a seed, so many seconds long, and run the case's detectors over it."""
    case, seed, seconds = asked
    walked = simulate(case, seed, seconds)
    tilted = case.mount.roll_deg != 0.0 or case.mount.pitch_deg != 0.0
    document = region_before(case.mount, Scene().ground_z, FIELD_X_M[1]) if tilted else WALKER_REGION
    region = Region.from_document(document)
    return [
        found(case.name, key, walked, region, detector, options)
        for key, (detector, options) in case.detectors.items()
    ]


def found(case: str, key: str, walked: Walked, region: Region, detector: str, options: Mapping[str, float]) -> Found:
    """What a detector finds in a walk."""
    reach = np.linalg.norm(walked.apexes, axis=1)
    detected = detect_range(Listed(walked.sweeps), region, detector, options, indices=range(len(walked.sweeps)))
    rows = [
        [
            *_errors(np.array(vertex.xyz), walked.apex_at(vertex.time_ns)),
            *_stated(vertex.covariance),
            reach[vertex.sweep_index],
            float(walked.rings[vertex.sweep_index] >= 2),
            float(vertex.quality == "fine"),
            float(bool(vertex.flags)),
        ]
        for vertex in detected.vertices
    ]
    return Found(case, key, reach[walked.rings >= 2], np.array(rows).reshape(-1, 10), detected.rejected)


def simulate(case: Case, seed: int, seconds: float) -> Walked:
    """The walk of a case."""
    scene = scene_with(case.disturbances.poles, seed)
    walk = HeldWalk(seed, seconds, scene.ground_z, plan="field", disturbances=case.disturbances, hold=case.hold)
    lidar = FlawedLidar(
        case.sensor,
        scene,
        walk,
        sector_deg=_SECTOR_DEG,
        noise_m=case.noise_m,
        seed=seed,
        disturbances=case.disturbances,
        mount=case.mount,
    )
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


def _errors(found: NDArray[np.float64], true: NDArray[np.float64]) -> list[float]:
    return (_angles(found) - _angles(true)).tolist()


def _stated(covariance: tuple[tuple[float, float, float], ...] | None) -> list[float]:
    if covariance is None:
        return [math.nan] * 3
    azimuth, elevation, reach = (math.sqrt(covariance[k][k]) for k in range(3))
    return [math.degrees(azimuth), math.degrees(elevation), reach]
