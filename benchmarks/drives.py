"""`python -m benchmarks.drives`: how often `apexcal check` notices a turned camera on drives, or accuses a sound one.

DRIVES simulated drives (20) of FRAMES frames each (12), from SEED on. On each there is a sound mount, and one turned
by 0.1, 0.2 and 0.5 degrees about one axis. One line of JSON.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from apexcal.documents.validations import AxisCheck, CameraCheck
from apexcal.geometry.se3 import to_document
from tests.support.scenes.drive import draw_drive, record
from tests.support.scenes.road import draw_road
from workers.simulation.camera import LENSES, SimulatedCamera, make_camera, nominal_mount
from workers.simulation.sensors import SENSORS
from workers.validation.calibration import KnownCalibration
from workers.validation.drive_check import judged
from workers.validation.edge_check import EdgeCheck
from workers.validation.lane_check import LaneCheck

# What a good calibration with a known lens leaves of the mount's turn (SPEC: 0.02 degrees).
LEFT_DEG = 0.02
SIZE = (640, 400)
AXES = ("pitch", "yaw", "roll")
TURNS_DEG = (0.1, 0.2, 0.5)
SOUND = "sound"
SENSORS_CHECKED = ("os1-64", "hdl64", "os1-128", "alpha-prime", "vlp16", "hdl32", "pandar40p", "vlp32c")


def check_drive(seed: int, frames: int) -> dict[str, CameraCheck]:
    """What the check says by the turn of the mount. Drives take turns among axes and sensors."""
    random = np.random.default_rng([seed, 33])
    camera = _camera(seed)
    axis, sign = seed % 3, random.choice((-1.0, 1.0))
    sensor = SENSORS[SENSORS_CHECKED[seed // 3 % len(SENSORS_CHECKED)]]
    turns = {f"{AXES[axis]} {turn_deg}": sign * turn_deg * np.eye(3)[axis] for turn_deg in TURNS_DEG} | {
        SOUND: np.zeros(3)
    }
    mounts = {name: _known(camera, turn + random.normal(0.0, LEFT_DEG, 3)) for name, turn in turns.items()}
    checks = {name: (EdgeCheck(mount), LaneCheck(mount)) for name, mount in mounts.items()}
    for sweep, image in record(draw_road(seed), draw_drive(seed), sensor, camera, seed, frames):
        for edges, lanes in checks.values():
            edges.add(sweep, image[..., 1].copy())
            lanes.add(sweep, image)
    return {name: _checked(name, edges.axes(), lanes.result()) for name, (edges, lanes) in checks.items()}


def _checked(name: str, axes: list[AxisCheck], lanes: dict[str, Any]) -> CameraCheck:
    verdict, sentence = judged(axes, lanes)
    return CameraCheck(name=name, verdict=verdict, sentence=sentence, axes=axes, lanes=lanes["verdict"])


def check_summary(driven: Sequence[dict[str, CameraCheck]]) -> dict[str, Any]:
    """Of sound mounts: how many are accused, in all, by a stop and by lane markers, and what tells anything.

    Of each turn: on how many drives any axis is accused, on how many its axis is told or that, and of how many; on
    how many lane markers disagree, on how many they tell anything.
    """
    sound = [drive[SOUND] for drive in driven]
    figures: dict[str, Any] = {
        "sound": len(sound),
        "sound_accused": sum(map(_accuses, sound)),
        "sound_stopped": sum(check.verdict == "stop" for check in sound),
        "sound_told": {axis: sum(_tells(check, axis) for check in sound) for axis in AXES},
        "sound_lanes": _by_lanes(sound),
    }
    for axis in AXES:
        for turn_deg in TURNS_DEG:
            turned = [drive[f"{axis} {turn_deg}"] for drive in driven if f"{axis} {turn_deg}" in drive]
            told = [check for check in turned if _accuses(check) or _tells(check, axis)]
            figures[f"{axis} {turn_deg}"] = [sum(map(_accuses, told)), len(told), len(turned), *_by_lanes(turned)]
    return figures


def _accuses(check: CameraCheck) -> bool:
    return check.verdict in ("look", "stop")


def _tells(check: CameraCheck, name: str) -> bool:
    return any(axis.axis == name and axis.verdict != "not_told" for axis in check.axes)


def _by_lanes(checks: Sequence[CameraCheck]) -> list[int]:
    """On how many drives lane markers disagree, and on how many they tell anything."""
    return [
        sum(check.lanes == "disagrees" for check in checks), sum(check.lanes != "unknown" for check in checks)
    ]  # fmt: skip


def _camera(seed: int) -> SimulatedCamera:
    """A camera 50 to 90 degrees wide on a mount that is off its drawing."""
    random = np.random.default_rng([seed, 31])
    mount = make_camera("pinhole", seed, nominal_mount(pitch_down_deg=random.uniform(0.0, 8.0))).T_camera_lidar
    f = SIZE[0] / 2 / np.tan(np.radians(random.uniform(25.0, 45.0)))
    lens = LENSES["pinhole"] | {"f_x": f, "f_y": f, "c_x": SIZE[0] / 2, "c_y": SIZE[1] / 2}
    return SimulatedCamera("pinhole", lens, SIZE, mount)


def _known(camera: SimulatedCamera, turn_deg: ArrayLike = (0.0, 0.0, 0.0)) -> KnownCalibration:
    transform = to_document(camera.T_camera_lidar)
    known = KnownCalibration.of({"intrinsics": camera.intrinsics_document(), "transform": transform})
    return known.moved(np.asarray(turn_deg, np.float64), np.zeros(3))


def main() -> None:
    """Print the figures, one line of JSON."""
    drives, frames = int(os.environ.get("DRIVES", "20")), int(os.environ.get("FRAMES", "12"))
    seed = int(os.environ.get("SEED") or secrets.randbelow(10**9))
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        checked = list(pool.map(partial(check_drive, frames=frames), range(seed, seed + drives)))
    print(json.dumps({"seed": seed, **check_summary(checked)}))


if __name__ == "__main__":
    main()
