"""Autoware's own files with one camera's pose changed, expanded by xacro with a kit of Autoware's structure."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xacro
import yaml

from apexcal.geometry.se3 import SE3
from service.exports.autoware_patch import patched
from service.exports.calibrated import Calibrated, CalibratedCamera, SolvedJoint, solved_edge
from service.platform.http.problems import Problem
from tests.service.exports.readers import _tree, files_of, joints, move, only, plumb_bob, published
from tests.service.exports.rigs import mount, ours, rig_of, seen

KIT = Path(__file__).parent / "kit"
SAID = (KIT / "sensor_kit_calibration.yaml").read_text()
OPTICAL = ("camera0/camera_optical_link", "camera1/camera_optical_link")


def expanded(folder: Path) -> dict[tuple[str, str], np.ndarray]:
    """The kit's tree as xacro makes it with the calibration files of the folder."""
    document = xacro.process_file(str(KIT / "vehicle.xacro"), mappings={"config_dir": str(folder)})
    return joints(document.toxml().encode())


def truck(*, joint: bool = True) -> Calibrated:
    """Two cameras, calibrated to mounts that differ from the kit's files, on joints of the kit's own tree."""
    edges, cameras = expanded(KIT), []
    for number, camera in enumerate(rig_of("pinhole", 0).cameras[:2]):
        T_camera_lidar = replace(mount(number, 1), to_frame=OPTICAL[number], from_frame="velodyne_top")
        T = _tree(edges, "sensor_kit_base_link", "velodyne_top")
        T_kit_lidar = SE3("sensor_kit_base_link", "velodyne_top", T[:3, :3], T[:3, 3])
        T = _tree(edges, "base_link", "velodyne_top")
        T_vehicle_lidar = SE3("base_link", "velodyne_top", T[:3, :3], T[:3, 3])
        body = f"camera{number}/camera_link"
        T = _tree(edges, body, OPTICAL[number])
        stated = SolvedJoint(T_kit_lidar, SE3(body, OPTICAL[number], T[:3, :3], T[:3, 3]))
        cameras.append(
            replace(
                camera,
                T_camera_lidar=T_camera_lidar,
                T_vehicle_lidar=T_vehicle_lidar,
                joint=stated if joint else None,
            )
        )
    return Calibrated("Truck", cameras)


def pixels(edges: dict[tuple[str, str], np.ndarray], camera: CalibratedCamera) -> np.ndarray:
    return plumb_bob(move(_tree(edges, camera.frame, "velodyne_top"), seen(camera)), np.array(camera.K), camera.D)


def test_the_kits_xacro_takes_the_files_and_mounts_the_cameras_where_they_are(tmp_path):
    calibrated = truck()
    shutil.copytree(KIT, tmp_path, dirs_exist_ok=True)
    text = SAID
    for number, camera in enumerate(calibrated.cameras):
        assert np.abs(pixels(expanded(tmp_path), camera) - ours(camera)).max() > 100, "not yet"
        text = patched(text, f"camera{number}/camera_link", camera)
        (tmp_path / "sensor_kit_calibration.yaml").write_text(text)
    for camera in calibrated.cameras:
        assert np.abs(pixels(expanded(tmp_path), camera) - ours(camera)).max() < 1e-4


def test_all_else_stays():
    camera = truck().cameras[0]
    text = patched(SAID, "camera0/camera_link", camera)
    old, new = yaml.safe_load(SAID), yaml.safe_load(text)
    assert all(isinstance(value, float) for value in new["sensor_kit_base_link"]["camera0/camera_link"].values())
    assert old["sensor_kit_base_link"].pop("camera0/camera_link") != new["sensor_kit_base_link"].pop(
        "camera0/camera_link"
    )
    assert old == new
    assert [line.partition("#")[2] for line in SAID.splitlines()] == [
        line.partition("#")[2] for line in text.splitlines()
    ]
    changed = [one for one, other in zip(SAID.splitlines(), text.splitlines(), strict=True) if one != other]
    assert len(changed) == 6
    crlf = patched(SAID.replace("\n", "\r\n"), "camera0/camera_link", camera)
    assert crlf == text.replace("\n", "\r\n")


def test_every_format_says_the_same_edge(tmp_path):
    """``ros2``, ``urdf`` and ``autoware`` give the camera the same pose in the same frame."""
    calibrated = truck()
    for camera in calibrated.cameras:
        edge = solved_edge(camera)
        of_ros2 = dict(published(line) for line in only(files_of("ros2", calibrated), ".txt").decode().splitlines())
        of_urdf = joints(next(iter(files_of("urdf", calibrated).values())))
        said = yaml.safe_load(only(files_of("autoware", calibrated), "sensor_kit_calibration.yaml"))
        pose = said[edge.to_frame][edge.from_frame]
        assert np.abs(of_ros2[edge.to_frame, edge.from_frame] - edge.matrix).max() < 1e-12
        assert np.abs(of_urdf[edge.to_frame, edge.from_frame] - edge.matrix).max() < 1e-12
        assert np.abs(np.array([pose["x"], pose["y"], pose["z"]]) - edge.t).max() < 1e-12
        assert np.abs(np.array([pose["roll"], pose["pitch"], pose["yaw"]]) - edge.roll_pitch_yaw).max() < 1e-12
    on_vehicle = yaml.safe_load(only(files_of("autoware", calibrated), "/sensors_calibration.yaml"))
    kit = yaml.safe_load((KIT / "sensors_calibration.yaml").read_text())
    for name, value in kit["base_link"]["sensor_kit_base_link"].items():
        assert on_vehicle["base_link"]["sensor_kit_base_link"][name] == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "child", "what"),
    [
        (SAID, "camera1/camera_link", "says where"),
        (SAID.replace("camera0", "camera7"), "camera0/camera_link", "no entry 'camera0/camera_link'"),
        (SAID.replace("sensor_kit_base_link", "base_link"), "camera0/camera_link", "no entry 'sensor_kit_base_link'"),
        (SAID.replace("    roll: 0.0\n", "", 1), "camera0/camera_link", "no entry 'roll'"),
        (SAID.replace("x: 0.1", "x: 0.1\n    x: 0.2", 1), "camera0/camera_link", "more than one entry 'x'"),
        (SAID.replace("x: 0.1", "x: &a 0.1", 1), "camera0/camera_link", "anchors"),
        (SAID.replace("x: 0.1", "x: [0.1]", 1), "camera0/camera_link", "no number"),
        ("a: [", "camera0/camera_link", "no YAML"),
        ("[" * 100_000, "camera0/camera_link", "brackets"),
        ("- " * 100_000, "camera0/camera_link", "no YAML"),
        ("[" * 999, "camera0/camera_link", "no YAML"),
        ("", "camera0/camera_link", "no entry"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(text, child, what):
    with pytest.raises(Problem) as refused:
        patched(text, child, truck().cameras[0])
    assert (refused.value.status, refused.value.code) == (422, "autoware_not_read") and what in refused.value.detail
