"""`apexcal check`: the calibration that a recording states, held against what it shows, without a service."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import apexcal
from apexcal.documents.validations import DriveCheck
from apexcal.geometry.rotations import rotation_from_vector
from apexcal.geometry.se3 import SE3, from_document
from tests.apexcal.test_cli import apexcal as run
from tests.contract.test_validations import SIZE, bag_of_a_drive
from tests.support.places import BOARD
from tests.workers.validation.roads import camera
from workers.readers.copying.copy_recording import copy_recording
from workers.readers.detect import open_recording


def deployed(bag: Path, out: Path, lens: dict[str, Any], T_camera_lidar: SE3, turn_deg=(0.0, 0.0, 0.0)) -> Path:
    """A copy of a bag with CameraInfo and ``/tf_static`` of a calibration, turned about the camera's axes."""
    recording = open_recording(bag)
    sensors = {sensor.kind: sensor for sensor in recording.sensors}
    recording.close()
    frame = T_camera_lidar.to_frame
    mount = SE3(frame, frame, rotation_from_vector(np.radians(turn_deg)), np.zeros(3)) @ T_camera_lidar
    pose = mount.inverse()
    edits = {
        "lidar_frame": sensors["lidar"].frame_id,
        "cameras": [
            lens | {"name": "front", "topic": sensors["camera"].name, "frame_id": sensors["camera"].frame_id}
        ],
        "poses": [
            {
                "parent": sensors["lidar"].frame_id,
                "child": sensors["camera"].frame_id,
                "translation_m": pose.t.tolist(),
                "quaternion_xyzw": list(pose.quaternion_xyzw),
                "is_new": True,
            }
        ],
    }
    return out / copy_recording(bag, out, edits, lambda share: None)["file"]


def checked(path: Path, *words: str) -> tuple[int, DriveCheck]:
    done = run("check", str(path), "--json", *words)
    assert done.stdout, done.stderr
    return done.returncode, DriveCheck.model_validate(json.loads(done.stdout))


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    return bag_of_a_drive(tmp_path_factory.mktemp("drive") / "drive.bag", frames=8)


@pytest.fixture(scope="module")
def lens() -> dict[str, Any]:
    values = camera(*SIZE).intrinsics
    K = [values.get(name, 0.0) for name in ("f_x", "s", "c_x", "zero", "f_y", "c_y")] + [0.0, 0.0, 1.0]
    return {"width": SIZE[0], "height": SIZE[1], "distortion_model": "plumb_bob", "K": K, "D": [0.0] * 5}


def test_a_sound_mount_passes_and_a_turned_one_is_stopped_at_its_axis(drive, lens, tmp_path) -> None:
    """The sound one is another file's."""
    mount = camera(*SIZE).T_camera_lidar
    sound_bag = deployed(drive, tmp_path / "sound", lens, mount)
    turned_bag = deployed(drive, tmp_path / "turned", lens, mount, (0.0, 0.5, 0.0))
    code, sound = checked(turned_bag, "--tf-from", str(sound_bag))
    (front,) = sound.cameras
    told = {axis.axis: axis.verdict for axis in front.axes}
    # Eight frames need not tell the roll.
    roll = told.pop("roll")
    assert (roll, front.verdict, code) in (("pass", "pass", 0), ("not_told", "not_told", 1))
    assert told == {"pitch": "pass", "yaw": "pass"} and front.lanes == "agrees"
    folder = tmp_path / "turned" / "recording.bag.check"
    assert [*map(folder.joinpath, front.pictures)] == sorted(folder.iterdir()) and len(front.pictures) == 3
    code, turned = checked(turned_bag, "-o", str(tmp_path / "t"))
    (front,) = turned.cameras
    (yaw,) = (axis for axis in front.axes if axis.verdict in ("look", "stop"))
    assert (code, front.verdict, yaw.axis, yaw.verdict) == (4, "stop", "yaw", "stop")
    assert yaw.turn_deg == pytest.approx(-0.5, abs=0.1)
    # Beside each picture of the deployed mount one of the mount that fits.
    assert len(front.pictures) == 6 and {path.name for path in (tmp_path / "t").iterdir()} == {*front.pictures}


def test_what_the_recording_does_not_state_is_said(drive, lens, tmp_path) -> None:
    urdf = tmp_path / "van.urdf"
    urdf.write_text("<robot")
    for file, problem in ((drive, "no_static_transforms"), (urdf, "urdf_not_read")):
        refused = run("check", str(drive), "--tf-from", str(file), "-o", str(tmp_path / "bare"))
        assert refused.returncode == 2 and problem in refused.stderr
    code, bare = checked(drive, "-o", str(tmp_path / "bare"))
    assert (code, bare.cameras[0].verdict) == (1, "not_told") and "mount is not stated" in bare.cameras[0].sentence
    again = run("check", str(drive), "-o", str(Path(__file__).parent))
    assert again.returncode == 2 and "holds files already" in again.stderr
    small = lens | {"width": 64, "height": 48}
    code, other = checked(deployed(drive, tmp_path / "small", small, camera(*SIZE).T_camera_lidar))
    assert (code, other.cameras[0].verdict) == (4, "stop") and "64 x 48" in other.cameras[0].sentence


def test_calibration_files_as_they_are_published_state_lens_and_mount(drive, lens, tmp_path) -> None:
    """KITTI's raw recordings: the lens in one file, the LiDAR's mount on camera 00 in the other."""
    mount = camera(*SIZE).T_camera_lidar
    rows = {"S_00": SIZE, "K_00": lens["K"], "D_00": lens["D"], "R_00": np.eye(3).ravel(), "T_00": np.zeros(3)}
    (tmp_path / "calib_cam_to_cam.txt").write_text(_rows(rows))
    (tmp_path / "calib_velo_to_cam.txt").write_text(_rows({"R": mount.R.ravel(), "T": mount.t}))
    words = [word for name in ("cam_to_cam", "velo_to_cam") for word in ("--tf-from", f"{tmp_path}/calib_{name}.txt")]
    code, sound = checked(drive, *words, "-o", str(tmp_path / "sound"))
    told = {axis.axis: axis.verdict for axis in sound.cameras[0].axes}
    assert code in (0, 1) and (told["pitch"], told["yaw"]) == ("pass", "pass"), sound
    refused = run("check", str(drive), *words[:2], "-o", str(tmp_path / "lens"), "--json")
    assert refused.returncode == 1 and "no lens with a mount" in refused.stdout
    (tmp_path / "notes.txt").write_text("nothing")
    refused = run("check", str(drive), "--tf-from", str(tmp_path / "notes.txt"), "-o", str(tmp_path / "none"))
    assert refused.returncode == 2 and "Traceback" not in refused.stderr


def _rows(rows: dict[str, Any]) -> str:
    return "".join(f"{name}: {' '.join(f'{value:.12e}' for value in values)}\n" for name, values in rows.items())


@pytest.mark.slow
@pytest.mark.skipif(not BOARD.exists(), reason="the real recordings are not here")
def test_a_real_recording_gets_a_verdict_and_a_real_turn_is_found(tmp_path) -> None:
    """The short form is the simulated drive above: a sound mount and one that is turned by as much."""
    rows = list(csv.DictReader((BOARD / "correspondences.csv").read_text().splitlines()))
    points, marks = ([[float(row[name]) for name in names] for row in rows] for names in ("xyz", "uv"))
    info = yaml.safe_load((BOARD / "camera_info.yaml").read_text())
    K, D = info["K"], info["D"]
    fit = apexcal.fit(points, marks, (1920, 1208), "kannala_brandt", (np.reshape(K, (3, 3)), D))
    mount = from_document(fit.transform.model_dump(mode="json"))
    lens = {"width": 1920, "height": 1208, "distortion_model": "equidistant", "K": K, "D": D}
    code, sound = checked(deployed(BOARD / "recording.bag", tmp_path / "sound", lens, mount))
    # Rings that are two degrees apart, and still poses, need not tell each turn.
    assert (code, sound.cameras[0].verdict) in ((0, "pass"), (1, "not_told")) and len(sound.cameras[0].pictures) == 3
    told = {axis.axis: axis.verdict for axis in sound.cameras[0].axes}
    assert told["yaw"] == "pass", sound
    turned = deployed(BOARD / "recording.bag", tmp_path / "turned", lens, mount, (0.0, 0.5, 0.0))
    code, turned_check = checked(turned)
    assert code == 4 and turned_check.cameras[0].verdict in ("look", "stop"), turned_check
