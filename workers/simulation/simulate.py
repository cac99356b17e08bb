"""Runs the rig: sweeps and frames in the order in which a recorder would get them, then the truth."""

from __future__ import annotations

import heapq
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from workers.geometry.models import ModelName
from workers.readers.recording import Frame
from workers.simulation.background import paint_background
from workers.simulation.bag import BagWriter
from workers.simulation.camera import CAMERA_FRAME, LIDAR_FRAME, Camera, make_camera
from workers.simulation.disturbances import Disturbances
from workers.simulation.lidar import Lidar
from workers.simulation.render import Renderer, encode_jpeg
from workers.simulation.scene import WALKER_REGION, scene_with
from workers.simulation.sensors import SENSORS, with_rings
from workers.simulation.truth import rig_document, truth_document
from workers.simulation.walker import BOARD_EDGES_M, Poses, Walk
from workers.simulation.walks import WALKS

LIDAR_TOPIC = "/velodyne_points"
CAMERA_TOPIC = "/camera/front/image/compressed"
START_NS = 1_780_000_000_000_000_000  # a morning in May 2026, UTC
_FRAME_RATE_HZ = 15.0
_SWEEP_DELAY_NS = 2_000_000  # from the last point to the recorder
_FRAME_DELAY_NS = 11_000_000  # exposure, compression, transport

OnProgress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True)
class Settings:
    """What to simulate.

    Attributes:
        seconds: length of the recording.
        seed: of the walk, the mount, the noise; the same settings give the same files.
        camera_model: the lens that the camera has.
        sensor: name in ``lidar.SENSORS``.
        rings: another number of rings over the sensor's elevations, or None.
        sector_deg: the LiDAR is set to azimuths of +- this much, as a VLP-16 can be.
        range_noise_mm: standard deviation of each range.
        walk: name in ``walks.WALKS``.
        board_m: lengths of the board's edges, to the left and to the right of the apex as the LiDAR sees it.
        disturbances: what makes the board harder to see.
        format: of the recording.

    Raises:
        ValueError: a value that cannot be simulated, said in one sentence.
    """

    seconds: float = 120.0
    seed: int = 1
    camera_model: ModelName = "brown_conrady"
    sensor: str = "vlp16"
    rings: int | None = None
    sector_deg: float = 60.0
    range_noise_mm: float = 8.0
    walk: str = "rows"
    board_m: tuple[float, float] = BOARD_EDGES_M
    disturbances: Disturbances = field(default_factory=Disturbances)
    format: Literal["bag"] = "bag"

    def __post_init__(self) -> None:
        checks = {
            f"seconds must lie between 1 and 3600, not {self.seconds}": 1.0 <= self.seconds <= 3600.0,
            f"seed must not be negative, not {self.seed}": self.seed >= 0,
            f"there is no sensor {self.sensor!r}; one of {', '.join(SENSORS)}": self.sensor in SENSORS,
            f"rings must lie between 4 and 128, not {self.rings}": self.rings is None or 4 <= self.rings <= 128,
            f"sector_deg must lie between 5 and 80, not {self.sector_deg}": 5.0 <= self.sector_deg <= 80.0,
            f"range_noise_mm must lie between 0 and 500, not {self.range_noise_mm}": (
                0.0 <= self.range_noise_mm <= 500.0
            ),
            f"there is no walk {self.walk!r}; one of {', '.join(WALKS)}": self.walk in WALKS,
            f"the board's edges must lie between 0.3 and 1.5 m, not at {self.board_m}": all(
                0.3 <= edge <= 1.5 for edge in self.board_m
            ),
        }
        for complaint, holds in checks.items():
            if not holds:
                raise ValueError(complaint)


@dataclass(frozen=True, slots=True)
class Simulated:
    """What was written."""

    recording: Path
    truth: Path
    rig: Path
    region: Path
    sweeps: int
    frames: int
    recording_bytes: int


class Rig:
    """Everything that the settings determine, before anything is written."""

    def __init__(self, settings: Settings) -> None:
        sensor = SENSORS[settings.sensor]
        self.settings = settings
        self.sensor = sensor if settings.rings is None else with_rings(sensor, settings.rings)
        self.scene = scene_with(settings.disturbances.poles, settings.seed)
        self.walk = Walk(
            settings.seed,
            settings.seconds,
            self.scene.ground_z,
            plan=settings.walk,
            disturbances=settings.disturbances,
            board_m=settings.board_m,
        )
        self.camera: Camera = make_camera(settings.camera_model, settings.seed)
        self.lidar = Lidar(
            self.sensor,
            self.scene,
            self.walk,
            sector_deg=settings.sector_deg,
            noise_m=settings.range_noise_mm * 1e-3,
            seed=settings.seed,
            disturbances=settings.disturbances,
        )
        random = np.random.default_rng([settings.seed, 5])
        self.sweep_stamps_ns = _stamps(random, settings.seconds, self.sensor.rate_hz, jitter_s=20e-6)
        # The camera runs free: nothing ties its clock's ticks to the LiDAR's turns.
        self.frame_stamps_ns = _stamps(random, settings.seconds, _FRAME_RATE_HZ * 0.9987, jitter_s=200e-6)


def simulate(settings: Settings, out_dir: Path, on_progress: OnProgress | None = None) -> Simulated:
    """Write ``recording.bag``, ``truth.json``, ``rig.json`` and ``region.json`` into ``out_dir``.

    Args:
        on_progress: called with (stage, done, total); stages are ``background`` and ``recording``.

    Raises:
        FileExistsError: ``out_dir`` holds a recording already.
    """
    report = on_progress or _silent
    out_dir.mkdir(parents=True, exist_ok=True)
    recording = out_dir / "recording.bag"
    rig = Rig(settings)
    with BagWriter(
        recording,
        lidar_topic=LIDAR_TOPIC,
        lidar_frame=LIDAR_FRAME,
        camera_topic=CAMERA_TOPIC,
        camera_frame=CAMERA_FRAME,
    ) as bag:
        report("background", 0, 1)
        renderer = Renderer(rig.camera, rig.scene, paint_background(rig.camera, rig.scene, settings.seed))
        report("background", 1, 1)
        _record(rig, renderer, bag, report)
    truth, description = _describe(rig)
    (out_dir / "truth.json").write_text(json.dumps(truth) + "\n", encoding="utf-8")
    (out_dir / "rig.json").write_text(json.dumps(description, indent=2) + "\n", encoding="utf-8")
    (out_dir / "region.json").write_text(json.dumps(WALKER_REGION, indent=2) + "\n", encoding="utf-8")
    return Simulated(
        recording=recording,
        truth=out_dir / "truth.json",
        rig=out_dir / "rig.json",
        region=out_dir / "region.json",
        sweeps=len(rig.sweep_stamps_ns),
        frames=len(rig.frame_stamps_ns),
        recording_bytes=recording.stat().st_size,
    )


def _record(rig: Rig, renderer: Renderer, bag: BagWriter, report: OnProgress) -> None:
    poses = rig.walk.poses((rig.frame_stamps_ns - START_NS).astype(np.float64) * 1e-9)
    turn_ns = round(rig.lidar.seconds_per_sector() * 1e9) + _SWEEP_DELAY_NS
    events = heapq.merge(
        _events("sweep", rig.sweep_stamps_ns, turn_ns), _events("frame", rig.frame_stamps_ns, _FRAME_DELAY_NS)
    )
    total = len(rig.sweep_stamps_ns) + len(rig.frame_stamps_ns)
    for done, (received_ns, kind, index) in enumerate(events, start=1):
        if kind == "sweep":
            stamp_ns = int(rig.sweep_stamps_ns[index])
            bag.write_sweep(rig.lidar.sweep(index, (stamp_ns - START_NS) * 1e-9, stamp_ns), received_ns)
        else:
            bag.write_frame(_frame(rig, renderer, poses, index), received_ns)
        report("recording", done, total)


def _frame(rig: Rig, renderer: Renderer, poses: Poses, index: int) -> Frame:
    width, height = rig.camera.image_size
    data = encode_jpeg(renderer.frame(poses, index))
    return Frame(int(rig.frame_stamps_ns[index]), data, "image/jpeg", width, height)


def _describe(rig: Rig) -> tuple[dict[str, Any], dict[str, Any]]:
    truth = truth_document(
        settings=asdict(rig.settings),
        camera=rig.camera,
        lidar=rig.lidar,
        walk=rig.walk,
        start_ns=START_NS,
        sweep_stamps_ns=rig.sweep_stamps_ns,
        frame_stamps_ns=rig.frame_stamps_ns,
    )
    return truth, rig_document(rig.camera, LIDAR_TOPIC, CAMERA_TOPIC)


def _stamps(random: np.random.Generator, seconds: float, rate_hz: float, jitter_s: float) -> NDArray[np.int64]:
    """Stamps from a random phase on; round(seconds x nominal rate) of them for the rates used here."""
    count = round(seconds * rate_hz)
    at = (np.arange(count) + random.uniform(0.0, 0.5)) / rate_hz + random.uniform(-jitter_s, jitter_s, count)
    return START_NS + np.round(np.maximum(at, 0.0) * 1e9).astype(np.int64)


def _events(kind: str, stamps_ns: NDArray[np.int64], delay_ns: int) -> Iterator[tuple[int, str, int]]:
    for index, stamp_ns in enumerate(stamps_ns.tolist()):
        yield stamp_ns + delay_ns, kind, index


def _silent(stage: str, done: int, total: int) -> None:
    """Nobody watches."""
