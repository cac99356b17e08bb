"""`python -m benchmarks.drives`: how often `apexcal check` notices a moved camera on drives, or accuses a sound one.

DRIVES simulated drives (300) of FRAMES frames each (8; the check looks at 30), from SEED on, a third standing, at 30
and at 100 km/h, with the errors of real sensors. On each there is a sound mount; on two of five there are also mounts
turned by 0.5 and 5 degrees about one axis and shifted by 10 cm along it. One line of JSON; 70 processor minutes.
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

from apexcal.documents.validations import CameraCheck
from apexcal.geometry.se3 import to_document
from tests.support.scenes.drive import draw_real_drive, record_pairs
from tests.support.scenes.road import draw_road
from workers.simulation.camera import LENSES, SimulatedCamera, make_camera, nominal_mount
from workers.simulation.sensors import SENSORS
from workers.validation.calibration import KnownCalibration
from workers.validation.edge_check import EdgeCheck
from workers.validation.lane_check import LaneCheck
from workers.validation.motion import motion_between

# What a good calibration with a known lens leaves of the mount's turn (SPEC: 0.02 degrees).
LEFT_DEG = 0.02
SIZE = (640, 400)
AXES = ("pitch", "yaw", "roll")
SPEEDS_M_S = (0.0, 30 / 3.6, 100 / 3.6)
TURNS_DEG = (0.5, 5.0)
SHIFT_M = 0.1
SOUND, SHIFTED = "sound", "shifted"
SENSORS_CHECKED = ("os1-64", "hdl64", "os1-128", "alpha-prime", "vlp16", "hdl32", "pandar40p", "vlp32c")


def check_drive(seed: int, is_moved: bool, *, frames: int) -> dict[str, CameraCheck]:
    """What the check says by what is wrong with the mount. Drives take turns among speeds, axes and sensors."""
    random = np.random.default_rng([seed, 33])
    camera = _camera(seed)
    number, sign = seed // 3 % 3, random.choice((-1.0, 1.0))
    sensor = SENSORS[SENSORS_CHECKED[seed // 9 % len(SENSORS_CHECKED)]]
    along = sign * np.eye(3)[number]
    moves = {SOUND: (0.0, 0.0)}
    if is_moved:
        moves |= {f"{AXES[number]} {turn_deg}": (turn_deg, 0.0) for turn_deg in TURNS_DEG}
        moves[f"{SHIFTED} {'xyz'[number]}"] = (0.0, SHIFT_M)
    left = {name: random.normal(0.0, LEFT_DEG, 3) for name in moves}
    mounts = {name: _known(camera, turn * along + left[name], shift * along) for name, (turn, shift) in moves.items()}
    checks = {name: (EdgeCheck(mount), LaneCheck(mount)) for name, mount in mounts.items()}
    drive = draw_real_drive(seed, SPEEDS_M_S[seed % 3])
    for sweep, following, image in record_pairs(draw_road(seed), drive, sensor, camera, seed, frames):
        motion = motion_between(sweep, following)
        if motion is None:
            continue
        for edges, lanes in checks.values():
            edges.add(sweep, image[..., 1].copy(), motion)
            lanes.add(sweep, image, motion)
    return {name: _checked(name, edges, lanes.result()) for name, (edges, lanes) in checks.items()}


def _checked(name: str, edges: EdgeCheck, lanes: dict[str, Any]) -> CameraCheck:
    verdict, sentence, axes = edges.verdict(lanes)
    return CameraCheck(name=name, verdict=verdict, sentence=sentence, axes=axes, lanes=lanes["verdict"])


def check_summary(driven: Sequence[dict[str, CameraCheck]]) -> dict[str, Any]:
    """Of sound mounts: how many are accused, by a stop, and on how many drives each axis is told.

    Of each turn: on how many drives it is accused, of how many where its axis is told or accused, of how many; and on
    how many of the accused that name a turn the axis is right. Of shifts along each axis: how many are accused, how
    many are called a shift, a turn, or either, of how many.
    """
    sound = [drive[SOUND] for drive in driven]
    figures: dict[str, Any] = {
        "sound": len(sound),
        "sound_accused": sum(map(_accuses, sound)),
        "sound_stopped": sum(check.verdict == "stop" for check in sound),
        "sound_told": {axis: sum(_tells(check, axis) for check in sound) for axis in AXES},
        "sound_told_by_speed": [sum(_tells(check, "yaw") for check in sound[first::3]) for first in range(3)],
    }
    for along in "xyz":
        shifted = [drive[f"{SHIFTED} {along}"] for drive in driven if f"{SHIFTED} {along}" in drive]
        figures[f"{SHIFTED} {along}"] = [sum(map(_accuses, shifted)), *_said(shifted), len(shifted)]
    for axis in AXES:
        for turn_deg in TURNS_DEG:
            turned = [drive[f"{axis} {turn_deg}"] for drive in driven if f"{axis} {turn_deg}" in drive]
            told = [check for check in turned if _accuses(check) or _tells(check, axis)]
            named = [check for check in turned if _named(check)]
            right = sum(_named(check) == axis for check in named)
            figures[f"{axis} {turn_deg}"] = {
                "found": [sum(map(_accuses, told)), len(told), len(turned)],
                "axis": [right, len(named)],
                "said": _said(turned),
            }
    return figures


def _accuses(check: CameraCheck) -> bool:
    return check.verdict in ("look", "stop")


def _tells(check: CameraCheck, name: str) -> bool:
    return any(axis.axis == name and axis.verdict != "not_told" for axis in check.axes)


def _named(check: CameraCheck) -> str | None:
    """The axis of the largest turn of which a camera is accused."""
    accused = [axis for axis in check.axes if axis.verdict in ("look", "stop")]
    return max(accused, key=lambda axis: abs(axis.turn_deg or 0.0)).axis if accused else None


def _said(checks: Sequence[CameraCheck]) -> list[int]:
    """How many are called a shift, a turn, or either."""
    words = [
        ("shifted" in check.sentence, "turned" in check.sentence or "far off" in check.sentence) for check in checks
    ]
    return [words.count(kind) for kind in ((True, False), (False, True), (True, True))]


def _camera(seed: int) -> SimulatedCamera:
    """A camera 50 to 90 degrees wide on a mount that is off its drawing."""
    random = np.random.default_rng([seed, 31])
    mount = make_camera("pinhole", seed, nominal_mount(pitch_down_deg=random.uniform(0.0, 8.0))).T_camera_lidar
    f = SIZE[0] / 2 / np.tan(np.radians(random.uniform(25.0, 45.0)))
    lens = LENSES["pinhole"] | {"f_x": f, "f_y": f, "c_x": SIZE[0] / 2, "c_y": SIZE[1] / 2}
    return SimulatedCamera("pinhole", lens, SIZE, mount)


def _known(
    camera: SimulatedCamera, turn_deg: ArrayLike = (0.0, 0.0, 0.0), shift_m: ArrayLike = (0.0, 0.0, 0.0)
) -> KnownCalibration:
    transform = to_document(camera.T_camera_lidar)
    known = KnownCalibration.of({"intrinsics": camera.intrinsics_document(), "transform": transform})
    return known.moved(np.asarray(turn_deg, np.float64), np.asarray(shift_m, np.float64))


def main() -> None:
    """Print the figures, one line of JSON."""
    drives, frames = int(os.environ.get("DRIVES", "300")), int(os.environ.get("FRAMES", "8"))
    seed = int(os.environ.get("SEED") or secrets.randbelow(10**9))
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        are_moved = [number < 0.4 * drives for number in range(drives)]
        checked = list(pool.map(partial(check_drive, frames=frames), range(seed, seed + drives), are_moved))
    print(json.dumps({"seed": seed, **check_summary(checked)}))


if __name__ == "__main__":
    main()
