"""One simulated walk, what each detector finds in it, and the offset that marks of its frames give."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from apexcal.documents.errors import InputError
from apexcal.documents.fit_requests import FitRequest, fit_request
from apexcal.geometry.se3 import to_document
from workers.simulation.camera import SimulatedCamera, make_camera, nominal_mount
from workers.simulation.lidar import SENSORS, SimulatedLidar
from workers.simulation.scene import WALKER_REGION, Scene
from workers.simulation.walker import BOARD_EDGES_M, Walk
from workers.solver.clock_offset import estimate_offset
from workers.vertices.detectors import detect_range
from workers.vertices.pairing import pair
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed
from workers.vertices.tracks import Track
from workers.vertices.vertex import Vertex

START_NS: Final = 1_780_000_000_000_000_000
MOST_MS: Final = 60.0
MODEL: Final = "brown_conrady"
_FRAME_RATE_HZ: Final = 14.98
_MAX_GAP_NS: Final = 50_000_000
_MARK_PX: Final = 1.0


@dataclass(frozen=True)
class Case:
    """What is done with a walk: the part of it that is used, the share of marks that are blunders, the detectors."""

    name: str
    seconds: float
    blunders: float = 0.0
    detectors: tuple[str, ...] = ("refined",)


@dataclass(frozen=True)
class Scenario:
    """A walk, by its name in ``walks.WALKS``, and the cases that share it."""

    walk: str
    seconds: float
    cases: tuple[Case, ...]


@dataclass(frozen=True)
class Found:
    """One estimate beside the truth, milliseconds; the estimate is None where it was refused."""

    case: str
    detector: str
    true_ms: float
    offset_ms: float | None
    sigma_ms: float | None
    marks: int
    code: str


def run(scenario: Scenario, seed: int) -> list[Found]:
    """Simulate the walk, run each detector over it; for each case mark the frames and estimate."""
    scene = Scene()
    walk = Walk(seed, scenario.seconds, scene.ground_z, plan=scenario.walk)
    lidar = SimulatedLidar(SENSORS["vlp16"], scene, walk, sector_deg=60.0, noise_m=0.008, seed=seed)
    start = np.random.default_rng([seed, 11]).uniform(0.0, 0.1)
    sweeps = []
    for index in range(int((scenario.seconds - 0.2) * lidar.sensor.rate_hz)):
        at = start + index / lidar.sensor.rate_hz
        sweeps.append(lidar.sweep(index, at, START_NS + round(at * 1e9)))
    region = Region.from_document(WALKER_REGION)
    board = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}
    vertices = {
        name: detect_range(
            Listed(sweeps), region, name, board if name == "refined" else None, indices=range(len(sweeps))
        ).vertices
        for name in sorted({name for case in scenario.cases for name in case.detectors})
    }
    camera = make_camera(MODEL, seed)
    return [
        _estimate(case, name, vertices[name], walk, camera, seed)
        for case in scenario.cases
        for name in case.detectors
    ]


def _estimate(
    case: Case, detector: str, found: list[Vertex], walk: Walk, camera: SimulatedCamera, seed: int
) -> Found:
    vertices = [vertex for vertex in found if vertex.time_ns < START_NS + case.seconds * 1e9]
    random = np.random.default_rng([seed, 12])
    true_ms = float(random.uniform(-MOST_MS, MOST_MS))
    moments_s = random.uniform(0.0, 0.06) + np.arange(int((case.seconds - 0.2) * _FRAME_RATE_HZ)) / _FRAME_RATE_HZ
    stamps = START_NS + np.round((moments_s + true_ms * 1e-3) * 1e9).astype(np.int64)
    # People mark the frames that were paired before anything was known of the offset.
    index, _ = pair([vertex.time_ns for vertex in vertices], stamps, max_gap_ns=_MAX_GAP_NS)
    frames = np.unique(index[index >= 0])
    pixels = camera.project(walk.poses(moments_s[frames]).apex)
    seen = camera.sees(pixels)
    frames, pixels = frames[seen], pixels[seen]
    pixels = pixels + random.normal(0.0, _MARK_PX, pixels.shape)
    wrong = random.random(len(pixels)) < case.blunders
    pixels[wrong] += random.uniform(-80.0, 80.0, (int(wrong.sum()), 2))
    blank = Found(case.name, detector, true_ms, None, None, len(frames), "")
    try:
        estimate = estimate_offset(Track.of(vertices), stamps[frames], pixels, _request(camera))
    except InputError as error:
        return replace(blank, code=error.code)
    return replace(blank, offset_ms=estimate.offset_ns * 1e-6, sigma_ms=estimate.sigma_ns * 1e-6)


def _request(camera: SimulatedCamera) -> FitRequest:
    return fit_request(camera.model, camera.image_size, to_document(nominal_mount()), mark_sigma_px=_MARK_PX)
