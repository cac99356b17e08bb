"""Everything that the settings determine: the scene, the walk, the sensors and when they look."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.se3 import SE3
from workers.readers.copying.edits import CameraEdit
from workers.readers.recording import Sweep
from workers.simulation.camera import Camera, make_camera, nominal_mount
from workers.simulation.driver import camera_info, frame_tree, rectified
from workers.simulation.lidar import Lidar
from workers.simulation.scene import scene_with
from workers.simulation.sensors import SENSORS, VLP16_LENS_M, LidarModel, with_rings
from workers.simulation.settings import PACKET_FORMATS, CameraSpec, Settings
from workers.simulation.walker import Walk

START_NS = 1_780_000_000_000_000_000  # a morning in May 2026, UTC
_SWEEP_JITTER_S = 20e-6
_FRAME_JITTER_S = 200e-6
_FREE_RUNNING = 0.9987  # nothing ties a camera's ticks to the LiDAR's turns


@dataclass(frozen=True, slots=True)
class MountedCamera:
    """A camera of the rig and when it looks.

    Attributes:
        camera: the lens and mount that draw the images.
        own: the same before the images are rectified.
        info: what its driver states; its images may be written without that.
        times_ns: (F,) when each frame was taken, by the LiDAR's clock.
        stamps_ns: (F,) what the camera's own clock said then, rising: what the recording holds.
    """

    spec: CameraSpec
    camera: Camera
    own: Camera
    info: CameraEdit
    times_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]


class Rig:
    """The simulated world, before anything is written: what benches and tests use that need no images.

    Attributes:
        camera, frame_stamps_ns: of the first camera.
        sweep_stamps_ns: (S,) when each sweep begins.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.sensor = _sensor(settings)
        self.scene = scene_with(settings.disturbances.poles, settings.seed)
        self.walk = Walk(
            settings.seed,
            settings.seconds,
            self.scene.ground_z,
            plan=settings.walk,
            disturbances=settings.disturbances,
            board_m=settings.board_m,
        )
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
        self.sweep_stamps_ns = _moments(random, settings.seconds, self.sensor.rate_hz, _SWEEP_JITTER_S)
        self.cameras = tuple(self._mounted(random, number) for number in range(len(settings.cameras)))

    @property
    def camera(self) -> Camera:
        return self.cameras[0].camera

    @property
    def frame_stamps_ns(self) -> NDArray[np.int64]:
        return self.cameras[0].stamps_ns

    def sweep(self, index: int) -> Sweep:
        """The sweep of that number."""
        stamp_ns = int(self.sweep_stamps_ns[index])
        return self.lidar.sweep(index, (stamp_ns - START_NS) * 1e-9, stamp_ns)

    def sweeps(self) -> Iterator[Sweep]:
        """All sweeps, in order."""
        return (self.sweep(index) for index in range(len(self.sweep_stamps_ns)))

    def _mounted(self, random: np.random.Generator, number: int) -> MountedCamera:
        settings = self.settings
        spec = settings.cameras[number]
        own = np.random.default_rng([settings.seed, 5, number]) if number else random
        times = _moments(own, settings.seconds, settings.camera_hz * _FREE_RUNNING, _FRAME_JITTER_S)
        stamps = times + round(settings.clock_offset_ms * 1e6)
        if settings.clock_jitter_ms > 0.0:
            stamps += np.round(own.normal(0.0, settings.clock_jitter_ms * 1e6, len(stamps))).astype(np.int64)
            count = np.arange(len(stamps))
            stamps = np.maximum.accumulate(stamps - count) + count  # a clock never goes back
        camera = self._as_mounted(number)
        info = camera_info(spec.name, camera, self._as_mounted(0), settings.seed, number)
        seen = rectified(camera, info) if settings.camera_info == "rectified" else camera
        return MountedCamera(spec, seen, camera, info, times, stamps)

    def _as_mounted(self, number: int) -> Camera:
        settings, spec = self.settings, self.settings.cameras[number]
        nominal = nominal_mount(spec.name, spec.yaw_deg, settings.pitch_down_deg)
        return make_camera(spec.model or settings.camera_model, settings.seed, nominal, number)

    def tree(self) -> list[SE3]:
        """T_parent_child of the frames that ``/tf_static`` and the URDF have."""
        settings = self.settings
        nominal = [nominal_mount(one.name, one.yaw_deg, settings.pitch_down_deg) for one in settings.cameras]
        true = [one.own.T_camera_lidar for one in self.cameras]
        return frame_tree(self.scene.ground_z, true if settings.tree == "true" else nominal)


def _sensor(settings: Settings) -> LidarModel:
    sensor = SENSORS[settings.sensor]
    if settings.rings is not None:
        return with_rings(sensor, settings.rings)
    # Decoders of the packets know where the beams really leave the sensor.
    return replace(sensor, lens_m=VLP16_LENS_M) if settings.format in PACKET_FORMATS else sensor


def _moments(random: np.random.Generator, seconds: float, rate_hz: float, jitter_s: float) -> NDArray[np.int64]:
    """Moments from a random phase on; round(seconds x nominal rate) of them for the rates used here."""
    count = round(seconds * rate_hz)
    at = (np.arange(count) + random.uniform(0.0, 0.5)) / rate_hz + random.uniform(-jitter_s, jitter_s, count)
    return START_NS + np.round(np.maximum(at, 0.0) * 1e9).astype(np.int64)
