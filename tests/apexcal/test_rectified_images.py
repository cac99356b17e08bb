"""Raw and rectified images of one drawn scene, each with the CameraInfo of its driver, from the bag to a URDF."""

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from apexcal.client import Client
from apexcal.demo.annotators import mark_everything
from apexcal.demo.truth import Truth
from workers.readers.detect import open_recording

SIZE = [960, 600]
FRAME = "camera_front_optical"
MODELS = {"raw": "brown_conrady", "rectified": "pinhole"}


def simulated(folder: Path, images: str, seed: int, seconds: float = 60.0) -> Path:
    command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), "--camera-info", images]
    more = ["--seed", str(seed), "--seconds", str(seconds), "--camera-hz", "8", "--json"]
    subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL)
    return folder


def calibrated(owner: Client, folder: Path, images: str):
    """The rig of the URDF, the bag's lens locked, marks with 1 px of noise: the result and the rig."""
    name = f"{folder.parent.name} {images}"
    fleet = owner.fleets.create(name)
    vehicle = owner.vehicles.create(fleet.id, name)
    camera = {"name": "front", "link": FRAME, "image_size": SIZE}
    text = (folder / "vehicle.urdf").read_text()
    draft = owner.imports.draft_rig(text, name="roof", lidar_link="velodyne", cameras=[camera]).rig
    rig = owner.vehicles.create_rig(vehicle.id, draft.model_dump(mode="json"))
    recording = owner.wait(owner.recordings.upload(folder / "recording.bag", vehicle.id, rig.id), timeout_s=240)
    region = json.loads((folder / "region.json").read_text())
    started = owner.detections.create(recording.id, region, detector="refined", mode="interpolate")
    detection = owner.wait(started, timeout_s=400)
    mark_everything(owner, fleet.id, detection, "front", Truth(folder / "truth.json"), lambda *_: None)
    pairs = owner.correspondence_sets.build(detection.id, "front")
    lens = {"intrinsics_from": "recording", "intrinsics_as": "locked", "folds": 0}
    made = owner.calibrations.create(vehicle.id, [pairs.id], [MODELS[images]], outliers="exclude", **lens)
    made = owner.wait(made, timeout_s=240)
    (found,) = made.summary.cameras["front"].models.values()
    return owner.calibrations.result(found.result_id), owner.vehicles.rig(rig.id), recording


def driver_pixels(folder: Path, images: str, urdf: str, points: np.ndarray) -> np.ndarray:
    """OpenCV's projection of points of the LiDAR by the vehicle's URDF and its driver's CameraInfo, as a node."""
    T = {"velodyne": np.eye(4)}
    joints = {}
    for joint in ElementTree.fromstring(urdf).iter("joint"):
        xyz, rpy = (np.array(joint.find("origin").get(name).split(), float) for name in ("xyz", "rpy"))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
        joints[joint.find("child").get("link")] = joint.find("parent").get("link"), pose

    def in_base(link: str) -> np.ndarray:
        parent, pose = joints[link]
        return pose if parent == "base_link" else in_base(parent) @ pose

    T = np.linalg.inv(in_base(FRAME)) @ in_base("velodyne")
    in_camera = points @ T[:3, :3].T + T[:3, 3]
    recording = open_recording(folder / "recording.bag")
    try:
        (info,) = (one.camera_info for one in recording.sensors if one.kind == "camera")
    finally:
        recording.close()
    if images == "raw":
        K, D, R = np.reshape(info["K"], (3, 3)), np.array(info["D"]), np.eye(3)
    else:
        K, D, R = np.reshape(info["P"], (3, 4))[:, :3], None, np.reshape(info["R"], (3, 3))
    return cv2.projectPoints(in_camera @ R.T, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)


def figures(owner: Client, folder: Path, images: str) -> dict[str, float]:
    result, rig, recording = calibrated(owner, folder, images)
    truth = json.loads((folder / "truth.json").read_text())
    T = truth["transform"]
    R, t = np.array(result.transform.rotation.matrix), np.array(result.transform.translation_m)
    R_true, t_true = np.array(T["rotation"]["matrix"]), np.array(T["translation_m"])
    turn_deg = np.degrees(Rotation.from_matrix(R @ R_true.T).as_rotvec())
    half = result.interval95_half_width
    print(
        result.transform.to_frame, result.std, half, turn_deg, t - t_true, recording.warnings, rig.cameras[0].images
    )
    patched = owner.exports.urdf_of_result(
        result.id, (folder / "vehicle.urdf").read_text(), "camera_front_link_joint"
    )
    frames = truth["frames"]
    seen = np.array(frames["apex_in_image"])
    points, pixels = np.array(frames["apex_xyz"])[seen], np.array(frames["apex_uv"], float)[seen]
    off = np.linalg.norm(driver_pixels(folder, images, patched, points) - pixels, axis=1)
    return {
        "turn_deg": float(np.linalg.norm(turn_deg)),
        "t_mm": float(1e3 * np.linalg.norm(t - t_true)),
        "off_px_median": float(np.median(off)),
        "off_px_max": float(off.max()),
        "rms": result.polished.rms_px,
    }


@pytest.mark.parametrize("images", ["raw", "rectified"])
def test_the_mount_is_right_with_the_drivers_lens(owner, tmp_path, images):
    found = figures(owner, simulated(tmp_path / "walk", images, seed=5), images)
    print(found)
    assert found["off_px_max"] < 1.0
