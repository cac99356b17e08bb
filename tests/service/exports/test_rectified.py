"""Rectified images: results and exports are of their frame, the vehicle's tree keeps the camera's own."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from sqlalchemy import select

from apexcal.geometry.se3 import SE3, from_document
from service.platform.db.fleets import RigCamera
from tests.service.calibrations.test_results import T_VEHICLE_LIDAR, current_address
from tests.service.exports.readers import fixed_axes, joints, rigid
from tests.service.exports.test_routes import URDF
from tests.support.databases import one_database

pytestmark = one_database
R = Rotation.from_rotvec(np.radians([0.7, -0.9, 0.4])).as_matrix()
TURNED = rigid(R, np.zeros(3))
OWN, IMAGES = "camera_front_optical", "camera_front_optical_rectified"
RECTIFIED = {"kind": "rectified", "rotation": {"matrix": R.tolist()}}
BODY = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
JOINT = {
    "T_parent_lidar": T_VEHICLE_LIDAR,
    "T_child_camera": {"to_frame": "camera_front_link", "from_frame": OWN, "rotation": {"matrix": BODY.tolist()},
                       "translation_m": [0.01, 0.02, 0.03]},
}  # fmt: skip


@pytest.fixture
def engineer(api, fleet):
    return api.member(fleet, "engineer")


def state(engineer, rig, images):
    etag = {"If-Match": engineer.get(f"/rigs/{rig.id}").headers["etag"]}
    made = engineer.patch(f"/rigs/{rig.id}/images", {"cameras": {"front": images}}, headers=etag)
    assert made.status_code == 200, made.text
    return made.json()["cameras"][0]["images"]


def solved(engineer, result) -> SE3:
    return from_document(engineer.get(f"/results/{result}").json()["transform"])


def exported(actor, rig, name):
    return actor.get(current_address(rig), params={"format": name}).content


def test_what_the_images_are_is_corrected_in_the_rig(api, fleet, rig, engineer):
    assert state(engineer, rig, RECTIFIED)["rotation"]["matrix"] == pytest.approx(R, abs=1e-15)
    assert state(engineer, rig, {"kind": "raw"}) == {"kind": "raw", "rotation": None}
    assert state(engineer, rig, None) is None
    address = f"/rigs/{rig.id}/images"
    etag = {"If-Match": engineer.get(f"/rigs/{rig.id}").headers["etag"]}
    assert engineer.patch(address, {"cameras": {}}).status_code == 428
    for cameras, code in (
        ({"side": RECTIFIED}, "unknown_camera"),
        ({"front": {"kind": "warped"}}, "invalid_request"),
        ({"front": RECTIFIED | {"rotation": {"matrix": (2.0 * R).tolist()}}}, "invalid_request"),
    ):
        refused = engineer.patch(address, {"cameras": cameras}, headers=etag)
        assert refused.json()["code"] == code, refused.text
    low = api.member(fleet, "reviewer").patch(address, {"cameras": {"front": None}}, headers=etag)
    assert low.status_code == 403


@pytest.mark.parametrize("joint", [None, JOINT], ids=["plain", "joint"])
def test_the_tree_keeps_its_frame_and_gets_that_of_the_images(api, rig, engineer, result, joint):
    with api.database.writing() as session:
        session.scalar(select(RigCamera).where(RigCamera.rig_id == rig.id)).joint = joint
    before = engineer.get(current_address(rig))
    state(engineer, rig, RECTIFIED)
    T = solved(engineer, result).matrix
    edges = joints(exported(engineer, rig, "urdf"))
    base = np.array(from_document(T_VEHICLE_LIDAR).matrix)
    own = base @ np.linalg.inv(T) @ TURNED  # the camera's own frame in base_link: T_own_images = R'
    if joint:
        body = from_document(joint["T_child_camera"]).matrix
        assert np.abs(edges["base_link", "camera_front_link"] - own @ np.linalg.inv(body)).max() < 1e-9
        assert np.abs(edges["camera_front_link", IMAGES] - body @ np.linalg.inv(TURNED)).max() < 1e-9
    else:
        assert np.abs(edges["velodyne", OWN] - np.linalg.inv(T) @ TURNED).max() < 1e-9
        assert np.abs(edges[OWN, IMAGES] - np.linalg.inv(TURNED)).max() < 1e-9
    # The document says the same, and a car that asks again gets it.
    again = engineer.get(current_address(rig), headers={"If-None-Match": before.headers["etag"]})
    document = again.json()
    assert (again.status_code, document["T_camera_lidar"]["to_frame"]) == (200, IMAGES)
    assert document["T_vehicle_camera"]["from_frame"] == IMAGES
    child = from_document(document["T_parent_child"])
    said = edges["base_link", "camera_front_link"] if joint else edges["velodyne", OWN]
    assert child.from_frame == ("camera_front_link" if joint else OWN) and np.abs(child.matrix - said).max() < 1e-9


def test_autoware_mounts_the_cameras_own_body(api, rig, engineer, result):
    """Its description turns the body into the own optical frame, whatever the images were turned by afterwards."""
    state(engineer, rig, RECTIFIED)
    with zipfile.ZipFile(io.BytesIO(exported(engineer, rig, "autoware"))) as archive:
        (name,) = [one for one in archive.namelist() if one.endswith("sensor_kit_calibration.yaml")]
        kit = yaml.safe_load(archive.read(name))["sensor_kit_base_link"]
    T_kit_lidar, T_kit_body = (placed(kit[child]) for child in ("velodyne", "front/camera_link"))
    own = T_kit_lidar @ np.linalg.inv(solved(engineer, result).matrix) @ TURNED
    assert np.abs(T_kit_body @ rigid(BODY, np.zeros(3)) - own).max() < 1e-9


def placed(pose) -> np.ndarray:
    return rigid(fixed_axes([pose["roll"], pose["pitch"], pose["yaw"]]), [pose["x"], pose["y"], pose["z"]])


def test_without_r_the_frame_of_the_rig_is_that_of_the_images(api, rig, engineer, result):
    plain = exported(engineer, rig, "urdf")
    state(engineer, rig, {"kind": "rectified"})
    assert exported(engineer, rig, "urdf") == plain
    assert "T_parent_child" not in engineer.get(current_address(rig)).json()


@pytest.mark.parametrize("name", ["camera_info", "ros2"])
def test_the_lens_is_exported_as_that_of_the_rectified_images(api, rig, engineer, result, name):
    state(engineer, rig, RECTIFIED)
    content = exported(engineer, rig, name)
    if name == "ros2":
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            content = archive.read("front/camera_info.yaml")
    assert content.startswith(f"# Of rectified images, in the frame {IMAGES}.\n".encode())
    lens = yaml.safe_load(content)
    K = np.reshape(lens["camera_matrix"]["data"], (3, 3))
    P = np.reshape(lens["projection_matrix"]["data"], (3, 4))
    assert np.array_equal(P, np.column_stack([K, np.zeros(3)]))
    assert np.array_equal(np.reshape(lens["rectification_matrix"]["data"], (3, 3)), np.eye(3))


def test_a_vehicles_own_urdf_has_the_cameras_own_frame(api, rig, engineer, result):
    state(engineer, rig, RECTIFIED)
    T = solved(engineer, result).matrix
    asked = {"urdf": URDF, "joint": "mount"}
    edges = joints(engineer.post(f"/results/{result}/urdf", asked).content)
    assert np.abs(edges["velodyne", OWN] - np.linalg.inv(T) @ TURNED).max() < 1e-9
    named = URDF.replace(OWN, IMAGES)
    asked = {"urdf": named, "joint": "mount", "camera_link": IMAGES}
    edges = joints(engineer.post(f"/results/{result}/urdf", asked).content)
    assert np.abs(edges["velodyne", IMAGES] - np.linalg.inv(T)).max() < 1e-9
