"""Everything that the options determine: the scene, the walk, the sensors and when they look."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.simulation import SimulationOptions
from apexcal.geometry.se3 import SE3
from workers.readers.copying.edits import CameraEdit
from workers.readers.recording import Sweep
from workers.simulation.camera import SimulatedCamera, make_camera, nominal_mount
from workers.simulation.driver import camera_info, frame_tree, rectified
from workers.simulation.lidar import SimulatedLidar
from workers.simulation.scene import scene_with
from workers.simulation.sensors import SENSORS, LidarModel, with_rings
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
        nominal: T_camera_lidar as the rig's drawing says.
        info: what its driver states; its images may be written without that.
        times_ns: (F,) when each frame was taken, by the LiDAR's clock.
        stamps_ns: (F,) what the camera's own clock said then, rising: what the recording holds.
    """

    name: str
    camera: SimulatedCamera
    own: SimulatedCamera
    nominal: SE3
    info: CameraEdit
    times_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]


class SimulatedRig:
    """The simulated world, before anything is written: what benches and tests use that need no images.

    Args:
        sensor: instead of the one that the options name.

    Attributes:
        camera, frame_stamps_ns: of the first camera.
        sweep_stamps_ns: (S,) when each sweep begins.
    """

    def __init__(self, options: SimulationOptions, sensor: LidarModel | None = None) -> None:
        self.options = options
        named = SENSORS[options.sensor]
        self.sensor = sensor or (named if options.rings is None else with_rings(named, options.rings))
        self.scene = scene_with(options.poles, options.seed)
        self.walk = Walk(
            options.seed,
            options.seconds,
            self.scene.ground_z,
            plan=options.walk,
            disturbances=options,
            board_m=options.board_m(),
        )
        self.lidar = SimulatedLidar(
            self.sensor,
            self.scene,
            self.walk,
            sector_deg=options.sector_deg,
            noise_m=options.range_noise_mm * 1e-3,
            seed=options.seed,
            disturbances=options,
        )
        random = np.random.default_rng([options.seed, 5])
        self.sweep_stamps_ns = _moments(random, options.seconds, self.sensor.rate_hz, _SWEEP_JITTER_S)
        self.cameras = tuple(self._mount_cameras(random))
        self.camera = self.cameras[0].camera
        self.frame_stamps_ns = self.cameras[0].stamps_ns

    def sweep(self, index: int) -> Sweep:
        """The sweep of that number."""
        stamp_ns = int(self.sweep_stamps_ns[index])
        return self.lidar.sweep(index, (stamp_ns - START_NS) * 1e-9, stamp_ns)

    def sweeps(self) -> Iterator[Sweep]:
        """All sweeps, in order."""
        return (self.sweep(index) for index in range(len(self.sweep_stamps_ns)))

    def _mount_cameras(self, first_random: np.random.Generator) -> Iterator[MountedCamera]:
        options, first = self.options, None
        for index, spec in enumerate(options.camera_specs()):
            nominal = nominal_mount(spec.name, spec.yaw_deg, options.pitch_down_deg)
            own = make_camera(spec.model or options.camera_model, options.seed, nominal, index)
            first = first or own
            info = camera_info(spec.name, own, first, options.seed, index)
            camera = rectified(own, info) if options.camera_info == "rectified" else own
            random = np.random.default_rng([options.seed, 5, index]) if index else first_random
            yield MountedCamera(spec.name, camera, own, nominal, info, *self._frame_times(random))

    def _frame_times(self, random: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        options = self.options
        times = _moments(random, options.seconds, options.camera_hz * _FREE_RUNNING, _FRAME_JITTER_S)
        stamps = times + round(options.clock_offset_ms * 1e6)
        if options.clock_jitter_ms > 0.0:
            stamps += np.round(random.normal(0.0, options.clock_jitter_ms * 1e6, len(stamps))).astype(np.int64)
            count = np.arange(len(stamps))
            stamps = np.maximum.accumulate(stamps - count) + count  # a clock never goes back
        return times, stamps

    def tree(self) -> list[SE3]:
        """T_parent_child of the frames that ``/tf_static`` and the URDF have."""
        is_true = self.options.tree == "true"
        mounts = [mounted.own.T_camera_lidar if is_true else mounted.nominal for mounted in self.cameras]
        return frame_tree(self.scene.ground_z, mounts)


def _moments(random: np.random.Generator, seconds: float, rate_hz: float, jitter_s: float) -> NDArray[np.int64]:
    """Moments from a random phase on; round(seconds x nominal rate) of them for the rates used here."""
    count = round(seconds * rate_hz)
    at = (np.arange(count) + random.uniform(0.0, 0.5)) / rate_hz + random.uniform(-jitter_s, jitter_s, count)
    return START_NS + np.round(np.maximum(at, 0.0) * 1e9).astype(np.int64)
