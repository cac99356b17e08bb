"""`python -m benchmarks.drives`: what a sound mount scores on drives, and how often a knocked camera is noticed.

Depth edges are looked at on simulated drives, lane markers on the real road where it is, else on a simulated one.
DRIVES: how many (20); FRAMES: of each (30); SEED: of the first. One line of JSON. ``CHECK=1`` counts what `apexcal
check` says instead: on each drive of a sound mount, and of one turned by 0.1, 0.2 and 0.5 degrees about one axis.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.validations import AxisCheck, CameraCheck
from apexcal.geometry.se3 import to_document
from tests.support.scenes.drive import draw_drive, record
from tests.support.scenes.road import draw_road
from workers.readers.recording import Sweep
from workers.readers.trees.pcd import read_pcd
from workers.simulation.camera import LENSES, SimulatedCamera, make_camera, nominal_mount
from workers.simulation.sensors import SENSORS
from workers.validation.calibration import KnownCalibration
from workers.validation.drive_check import judged
from workers.validation.edge_check import EdgeCheck
from workers.validation.lane_check import LaneCheck

DATA = Path(__file__).parents[1].parent / "shared" / "data"
KNOCK_DEG = 0.25
# Sound mounts, and as many knocks in even directions, that are judged on one drive.
MOUNTS = 10
# What a good calibration with a known lens leaves of the mount's turn (SPEC: 0.02 degrees).
LEFT_DEG = 0.02
SIZE = (640, 400)
AXES = ("pitch", "yaw", "roll")
TURNS_DEG = (0.1, 0.2, 0.5)
SOUND = "sound"
_SHOWN = ("verdict", "yaw_deg", "pitch_deg", "sigma_yaw_deg", "sigma_pitch_deg")
SENSORS_USED = ("os1-64", "hdl64", "os1-128", "alpha-prime")

SENSORS_CHECKED = (*SENSORS_USED, "vlp16", "hdl32", "pandar40p", "vlp32c")


class OnDrive(NamedTuple):
    """Verdicts on one drive: of sound mounts, of knocked ones, and on the same road without anything beside it."""

    sound: list[str]
    knocked: list[str]
    empty: str
    ms_per_frame: float


def on_drive(seed: int, frames: int) -> OnDrive:
    """Simulate a drive and judge mounts on it."""
    return _knocks(seed, frames)._replace(empty=_empty(seed, max(frames // 3, 1)))


def summary(driven: Sequence[OnDrive]) -> dict[str, Any]:
    """The figures over all drives; null where there are none."""
    sound = [verdict for one in driven for verdict in one.sound]
    knocked = [verdict for one in driven for verdict in one.knocked]
    return {
        "knock_found": _share(knocked, "disagrees"),
        "knock_false": _share(sound, "disagrees"),
        "knock_unknown": _share(sound, "unknown"),
        "knock_drives": len(driven),
        "knock_ms_per_frame": round(float(np.median([one.ms_per_frame for one in driven])), 1) if driven else None,
        "empty_unknown": _share([one.empty for one in driven], "unknown"),
    }


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


def _share(verdicts: Sequence[str], wanted: str) -> float | None:
    return round(verdicts.count(wanted) / len(verdicts), 3) if verdicts else None


def lane_figures() -> dict[str, Any]:
    """The published mount on the real road; a simulated one where that is absent."""
    check = LaneCheck(known := _published()) if (DATA / "road-lane-markers").exists() else None
    if check is not None:
        check.add(_real_sweep(), cv2.imread(str(DATA / "road-lane-markers" / "calib.png")))
        found, where = check.result(), "real"
        assert known.image_size == (1920, 1200)
    else:
        camera = _camera(1)
        check = LaneCheck(_known(camera))
        for sweep, image in record(draw_road(1), draw_drive(1), SENSORS["os1-64"], camera, 1, 3):
            check.add(sweep, image)
        found, where = check.result(), "simulated"
    return {
        "lane_score": found["score"],
        "lane_score_ratio": found["score"] / max(found["score_at_one_degree"], 1e-3),
        "lane_peak_deg": float(np.hypot(found["yaw_deg"], found["pitch_deg"])),
        "lane_road": where,
    }


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


def _knocks(seed: int, frames: int) -> OnDrive:
    """Verdicts under what good calibrations leave, and under knocks in all directions beside it."""
    random = np.random.default_rng([seed, 32])
    camera = _camera(seed)
    sensor = SENSORS[SENSORS_USED[seed % len(SENSORS_USED)]]
    angles = random.uniform(0.0, 2.0 * np.pi) + 2.0 * np.pi * np.arange(MOUNTS) / MOUNTS
    knocks = KNOCK_DEG * np.column_stack([np.sin(angles), np.cos(angles), np.zeros(MOUNTS)])
    left = random.normal(0.0, LEFT_DEG, (2 * MOUNTS, 3))
    turns = left + np.concatenate([np.zeros((MOUNTS, 3)), knocks])
    checks = [EdgeCheck(_known(camera, turn)) for turn in turns]
    spent = 0.0
    for sweep, image in record(draw_road(seed), draw_drive(seed), sensor, camera, seed, frames):
        grey = image[..., 1].copy()
        began = time.process_time()
        for check in checks:
            check.add(sweep, grey)
        spent += time.process_time() - began
    results = [check.result() for check in checks]
    verdicts = [one["verdict"] for one in results]
    for turn, one in zip(turns, results, strict=True):
        line = {"seed": seed, "sensor": sensor.name, "turn": np.round(turn, 3).tolist()}
        print(json.dumps(line | {name: one.get(name) for name in _SHOWN}), file=sys.stderr, flush=True)
    return OnDrive(verdicts[:MOUNTS], verdicts[MOUNTS:], "", 1e3 * spent / (len(checks) * frames))


def _empty(seed: int, frames: int) -> str:
    camera = _camera(seed)
    check = EdgeCheck(_known(camera))
    road = draw_road(seed, is_empty=True, is_painted=seed % 2 == 0)
    for sweep, image in record(road, draw_drive(seed), SENSORS["os1-64"], camera, seed, frames):
        check.add(sweep, image[..., 1].copy())
    verdict: str = check.result()["verdict"]
    return verdict


def _published() -> KnownCalibration:
    folder = DATA / "road-lane-markers"
    lens = json.loads((folder / "center_camera-intrinsic.json").read_text())["center_camera-intrinsic"]["param"]
    name = "top_center_lidar-to-center_camera-extrinsic"
    mount = np.array(json.loads((folder / f"{name}.json").read_text())[name]["param"]["sensor_calib"]["data"])
    K, D = lens["cam_K"]["data"], lens["cam_dist"]["data"][0]
    intrinsics = {"model": "brown_conrady", "f_x": K[0][0], "f_y": K[1][1], "c_x": K[0][2], "c_y": K[1][2]}
    intrinsics |= dict(zip(("k1", "k2", "k3", "k4", "k5"), D, strict=True)) | {"image_size": [1920, 1200]}
    U, _, Vt = np.linalg.svd(mount[:3, :3])
    transform = {"to_frame": "camera", "from_frame": "lidar", "rotation": {"matrix": (U @ Vt).tolist()}}
    transform["translation_m"] = mount[:3, 3].tolist()
    return KnownCalibration.of({"intrinsics": intrinsics, "transform": transform})


def _real_sweep() -> Sweep:
    cloud = read_pcd((DATA / "road-lane-markers" / "calib.pcd").read_bytes(), "calib.pcd")
    xyz: NDArray[np.float32] = np.column_stack([cloud[axis] for axis in "xyz"]).astype(np.float32)
    there = np.isfinite(xyz).all(axis=1) & np.any(xyz != 0.0, axis=1)
    ring, intensity = cloud["ring"][there].astype(np.uint16), cloud["intensity"][there].astype(np.float32)
    return Sweep(0, xyz[there], intensity, ring, np.zeros(len(ring), np.int64))


def main() -> None:
    """Print the figures, one line of JSON."""
    drives, frames = int(os.environ.get("DRIVES", "20")), int(os.environ.get("FRAMES", "30"))
    seed = int(os.environ.get("SEED") or secrets.randbelow(10**9))
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        if os.environ.get("CHECK"):
            checked = list(pool.map(partial(check_drive, frames=frames), range(seed, seed + drives)))
            print(json.dumps({"seed": seed, **check_summary(checked)}))
            return
        verdicts = list(pool.map(partial(on_drive, frames=frames), range(seed, seed + drives)))
    print(json.dumps({"seed": seed, **lane_figures(), **summary(verdicts)}))


if __name__ == "__main__":
    main()
