"""Files, comparisons and rig drafts over HTTP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.fleets import NewRig
from apexcal.geometry.se3 import from_document
from service.exports.urdf_patch import patched
from service.exports.urdf_tree import read_joints
from service.imports.drafting import urdf_tree
from service.platform.db.recordings import Recording
from tests.service.calibrations.test_results import DOCUMENT, current_address, seed_results
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.service.publications.given import publish
from tests.support.databases import one_database
from tests.support.rows import LEVEL

pytestmark = one_database

URDF = """<robot name="car">
  <link name="base_link"/><link name="velodyne"/><link name="camera_link"/><link name="camera_front_optical"/>
  <joint name="lidar_joint" type="fixed"><parent link="base_link"/><child link="velodyne"/>
    <origin xyz="1.2 0 1.9" rpy="0 0 0.05"/></joint>
  <joint name="camera_joint" type="fixed"><parent link="base_link"/><child link="camera_link"/>
    <origin xyz="1.5 0.1 1.4" rpy="0.01 0.02 0.03"/></joint>
  <joint name="optical_joint" type="fixed"><parent link="camera_link"/><child link="camera_front_optical"/>
    <origin xyz="0 0 0" rpy="-1.5707963267948966 0 -1.5707963267948966"/></joint>
</robot>"""
CAMERA = {"name": "front", "link": "camera_front_optical", "image_size": [640, 480]}
ASKED = {"name": "roof", "lidar_link": "velodyne", "cameras": [CAMERA]}


def refusal(answer, status, code) -> str:
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text
    return answer.json()["detail"]


def test_files_are_read(viewer):
    text = "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
    text += "camera_matrix: {data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\ndistortion_coefficients: {data: []}\n"
    found = viewer.post("/calibration-files/reading", {"files": {"front.yaml": text}})
    assert found.status_code == 200, found.text
    (camera,) = found.json()["cameras"]
    assert (found.json()["format"], camera["lens"]["model"]) == ("camera_info", "brown_conrady")
    refusal(viewer.post("/calibration-files/reading", {"files": {"a.txt": "?"}}), 422, "calibration_file_not_read")
    assert viewer.post("/calibration-files/reading", {"files": {"a": "x" * 60_001}}).status_code == 422


class TestComparison:
    @pytest.fixture
    def compare(self, api, fleet, viewer):
        _, (result, _) = seed_results(api, seed_rig(api.database, fleet))

        def ask(**body):
            return viewer.post(f"/results/{result}/comparison", body)

        return ask

    def test_a_mount_beside_the_results(self, compare):
        moved = LEVEL | {"translation_m": [0.03, -0.1, -0.2]}
        found = compare(T_camera_lidar=moved).json()
        assert found["read_as"] == "stated" and found["rotation_deg"] == pytest.approx(0.0, abs=1e-5)
        assert found["translation_mm"] == pytest.approx(30.0)
        # The result states 0.01 m for t_x and nothing else.
        assert found["sigmas"] == pytest.approx(3.0) and found["differs"] is False
        assert compare(T_camera_lidar=LEVEL | {"translation_m": [0.04, -0.1, -0.2]}).json()["differs"] is True

    @pytest.mark.parametrize(
        ("read_as", "change"),
        [
            ("inverted", lambda T: T.inverse()),
            ("body", lambda T: replace(T, R=np.eye(3))),
            ("none", lambda T: replace(T, R=np.diag([-1.0, -1.0, 1.0]) @ T.R)),
        ],
    )
    def test_a_transform_that_is_read_the_wrong_way_is_named(self, compare, read_as, change):
        T = change(from_document(LEVEL))
        stated = {
            "to_frame": "camera", "from_frame": "lidar", "rotation": {"matrix": T.R.tolist()},
            "translation_m": T.t.tolist(),
        }  # fmt: skip
        found = compare(T_camera_lidar=stated).json()
        assert found["read_as"] == read_as and found["hints"] and found["rotation_deg"] > 90

    def test_files_with_several_cameras_ask_for_one(self, compare):
        lens = "500 0 320 0 0 500 240 0 0 0 1 0"
        tr = "0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.2"
        files = {"files": {"calib.txt": f"P0: {lens}\nP1: {lens}\nTr: {tr}\n"}, "image_size": [640, 480]}
        assert "P0, P1" in refusal(compare(files=files), 422, "calibration_file_not_read")
        found = compare(files=files, camera="P1").json()
        assert found["translation_mm"] == pytest.approx(0.0) and found["lens"]["f_y"] == pytest.approx(1.0)
        assert any("pinhole" in one for one in found["hints"])

    def test_swapped_frames_and_nothing_are_refused(self, compare):
        swapped = LEVEL | {"to_frame": "velodyne", "from_frame": "camera_front_optical"}
        assert "the opposite" in refusal(compare(T_camera_lidar=swapped), 422, "invalid_request")
        refusal(compare(), 422, "nothing_to_compare")
        refusal(compare(T_camera_lidar=LEVEL, files={"files": {"a": "b"}}), 422, "nothing_to_compare")


class TestDraft:
    def test_a_urdf_becomes_a_rig_that_the_service_takes(self, api, fleet, viewer):
        answer = viewer.post("/rig-drafts", ASKED | {"urdf": URDF})
        assert answer.status_code == 200, answer.text
        rig = answer.json()["rig"]
        assert "camera_joint" in answer.json()["notes"][0]
        tree, (camera,) = urdf_tree(URDF.encode()), rig["cameras"]
        T = tree.transform("camera_front_optical", "velodyne")
        assert camera["nominal"]["translation_m"] == pytest.approx(T.t.tolist())
        assert rig["T_vehicle_lidar"]["to_frame"] == "base_link"
        assert rig["T_vehicle_lidar"]["translation_m"] == pytest.approx([1.2, 0.0, 1.9])
        joint = camera["joint"]
        assert (
            joint["T_parent_lidar"]["to_frame"] == "base_link"
            and joint["T_child_camera"]["to_frame"] == "camera_link"
        )
        NewRig.model_validate(rig)
        engineer = api.member(fleet, "engineer")
        vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}).json()["id"]
        made = engineer.post(f"/vehicles/{vehicle}/rigs", rig)
        assert made.status_code == 201 and made.json()["cameras"][0]["joint"] == joint

    def test_a_recordings_static_transforms_do_too(self, api, fleet, viewer):
        rig = seed_rig(api.database, fleet)
        recording, _ = seed_recording(api.database, rig, 3)
        address = f"/recordings/{recording}/rig-drafts"
        refusal(viewer.post(address, ASKED), 409, "no_static_transforms")
        with api.database.writing() as session:
            session.get_one(Recording, recording).facts = {
                "static_transforms": [
                    {
                        "parent": one.parent, "child": one.child,
                        "translation_m": one.T_parent_child.t.tolist(),
                        "quaternion_xyzw": one.T_parent_child.quaternion_xyzw,
                    }
                    for one in read_joints(URDF.encode()).values()
                ]
            }  # fmt: skip
        drafted = viewer.post(address, ASKED).json()["rig"]
        from_urdf = viewer.post("/rig-drafts", ASKED | {"urdf": URDF}).json()["rig"]
        for name in ("nominal",):
            for key in ("translation_m",):
                assert drafted["cameras"][0][name][key] == pytest.approx(from_urdf["cameras"][0][name][key])
        assert drafted["cameras"][0]["joint"]["T_parent_lidar"]["to_frame"] == "base_link"

    @pytest.mark.parametrize(
        ("change", "asked", "says"),
        [
            ({}, {"lidar_link": "laser"}, "no frame 'laser'"),
            ({}, {"cameras": [CAMERA | {"joint": "lidar_joint"}]}, "not on the camera's side"),
            ({'name="camera_joint" type="fixed"': 'name="camera_joint" type="revolute"'}, {}, "'camera_joint'"),
            ({'name="lidar_joint" type="fixed"': 'name="lidar_joint" type="revolute"'}, {}, "'lidar_joint'"),
            (
                {'<parent link="base_link"/><child link="camera_link"/>': '<child link="camera_link"/>'},
                {},
                "No joints",
            ),
            ({'child link="camera_link"': 'child link="velodyne"'}, {}, "No joints lead"),
        ],
    )
    def test_a_tree_that_does_not_say_it_is_refused(self, viewer, change, asked, says):
        text = URDF
        for old, new in change.items():
            text = text.replace(old, new)
        assert says in refusal(viewer.post("/rig-drafts", ASKED | {"urdf": text} | asked), 422, "frames_not_usable")

    def test_a_frame_with_two_parents_and_a_circle_are_refused(self, viewer):
        def with_joint(parent, child):
            one = f'<joint name="x" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint></robot>'
            return viewer.post("/rig-drafts", ASKED | {"urdf": URDF.replace("</robot>", one)})

        assert "two parents" in refusal(with_joint("velodyne", "camera_link"), 422, "frames_not_usable")
        assert "own ancestor" in refusal(with_joint("camera_front_optical", "base_link"), 422, "frames_not_usable")


class TestJoint:
    @pytest.fixture
    def rig(self, api, fleet, viewer):
        """A rig drafted from the URDF, whose published result is DOCUMENT's mount."""
        rig = seed_rig(api.database, fleet)
        drafted = viewer.post("/rig-drafts", ASKED | {"urdf": URDF}).json()["rig"]
        with api.database.writing() as session:
            row = session.get_one(type(rig), rig.id)
            row.cameras[0].joint = drafted["cameras"][0]["joint"]
            row.T_vehicle_lidar = drafted["T_vehicle_lidar"]
        publish(api, rig, api.member(fleet, "reviewer"))
        return rig

    def test_results_are_given_for_the_joint_as_the_patched_urdf_has_it(self, viewer, rig):
        given = viewer.get(current_address(rig)).json()
        joint = given["T_parent_child"]
        assert (joint["to_frame"], joint["from_frame"]) == ("base_link", "camera_link")
        mount = from_document(DOCUMENT["transform"])
        patched_joint = read_joints(patched(URDF.encode(), "camera_joint", mount))["camera_joint"].T_parent_child
        assert np.abs(from_document(joint).matrix - patched_joint.matrix).max() < 1e-12

    def test_a_joint_that_is_not_between_lidar_and_camera_is_refused(self, api, fleet, viewer):
        engineer = api.member(fleet, "engineer")
        vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}).json()["id"]
        rig = viewer.post("/rig-drafts", ASKED | {"urdf": URDF}).json()["rig"]
        joint = rig["cameras"][0]["joint"]
        joint["T_parent_lidar"], joint["T_child_camera"] = joint["T_child_camera"], joint["T_parent_lidar"]
        refused = engineer.post(f"/vehicles/{vehicle}/rigs", rig)
        assert (
            refused.status_code == 422 and "joint.T_parent_lidar of front maps points of 'velodyne'" in refused.text
        )
