"""Files, comparisons and proposed rigs over HTTP."""

from __future__ import annotations

from dataclasses import replace
from uuid import UUID

import numpy as np
import pytest

from apexcal.geometry.se3 import from_document
from apexcal.geometry.urdf_tree import read_joints
from service.exports.urdf_patch import patched
from service.platform.db.recordings import Recording, Sensor
from tests.apexcal.geometry.test_rig_proposal import URDF
from tests.service.calibrations.test_results import DOCUMENT, current_address, seed_results
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.service.publications.given import publish
from tests.support.databases import one_database
from tests.support.rows import LEVEL, add

pytestmark = one_database


def refusal(answer, status, code) -> str:
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text
    return answer.json()["detail"]


def recorded(api, rig) -> str:
    """A recording whose sensors have the frames of URDF, and whose images have a size."""
    recording, camera = seed_recording(api.database, rig, 3)
    with api.database.writing() as session:
        row = session.get_one(Sensor, camera)
        row.frame_id, row.facts = "camera_front_optical", {"width": 640, "height": 480}
        session.query(Sensor).filter_by(recording_id=recording, name="lidar").one().frame_id = "velodyne"
    return str(recording)


def proposed(api, rig, viewer) -> dict:
    return viewer.post(f"/recordings/{recorded(api, rig)}/rig-proposals", {"urdf": URDF}).json()["rig"]


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


class TestProposal:
    def test_rows_a_urdf_and_answers_become_a_rig_that_the_service_takes(self, api, fleet, viewer):
        recording = recorded(api, seed_rig(api.database, fleet))
        address = f"/recordings/{recording}/rig-proposals"
        (question,) = viewer.post(address, {}).json()["questions"]
        assert (question["sensor"], question["asks"]) == ("front", "looks")
        answer = viewer.post(address, {"urdf": URDF})
        assert answer.status_code == 200 and not answer.json()["questions"], answer.text
        rig = answer.json()["rig"]
        assert (rig["lidar"]["topic"], rig["cameras"][0]["image_size"]) == ("/lidar", [640, 480])
        engineer = api.member(fleet, "engineer")
        vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}).json()["id"]
        made = engineer.post(f"/vehicles/{vehicle}/rigs", rig)
        assert made.status_code == 201 and made.json()["cameras"][0]["joint"] == rig["cameras"][0]["joint"]
        with api.database.writing() as session:
            session.get_one(Recording, UUID(recording)).facts = {
                "static_transforms": [
                    {
                        "parent": one.parent, "child": one.child,
                        "translation_m": one.T_parent_child.t.tolist(),
                        "quaternion_xyzw": one.T_parent_child.quaternion_xyzw,
                    }
                    for one in read_joints(URDF.encode()).values()
                ]
            }  # fmt: skip
        (of_recording,) = viewer.post(address, {}).json()["rig"]["cameras"]
        for axis, value in enumerate(rig["cameras"][0]["nominal"]["translation_m"]):
            assert of_recording["nominal"]["translation_m"][axis] == pytest.approx(value)

    @pytest.mark.parametrize(
        ("body", "code"),
        [
            ({"urdf": "<robot"}, "urdf_not_read"),
            ({"urdf": URDF, "looks": {"rear": "left"}}, "frames_not_usable"),
            ({"looks": {"front": "up"}}, "invalid_request"),
        ],
    )
    def test_what_cannot_be_used_is_refused(self, api, fleet, viewer, body, code):
        recording = recorded(api, seed_rig(api.database, fleet))
        refusal(viewer.post(f"/recordings/{recording}/rig-proposals", body), 422, code)

    def test_a_recording_that_was_not_read_has_none(self, api, fleet, viewer):
        with api.database.writing() as session:
            recording = add(session, Recording, seed_rig(api.database, fleet), state="uploading")
        refusal(viewer.post(f"/recordings/{recording.id}/rig-proposals", {}), 422, "not_read")


class TestJoint:
    @pytest.fixture
    def rig(self, api, fleet, viewer):
        """A rig proposed with the URDF, whose published result is DOCUMENT's mount."""
        rig = seed_rig(api.database, fleet)
        drafted = proposed(api, rig, viewer)
        with api.database.writing() as session:
            row = session.get_one(type(rig), rig.id)
            row.cameras[0].joint = drafted["cameras"][0]["joint"]
            row.lidar.T_vehicle_lidar = drafted["T_vehicle_lidar"]
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
        rig = proposed(api, seed_rig(api.database, fleet), viewer)
        joint = rig["cameras"][0]["joint"]
        joint["T_parent_lidar"], joint["T_child_camera"] = joint["T_child_camera"], joint["T_parent_lidar"]
        refused = engineer.post(f"/vehicles/{vehicle}/rigs", rig)
        assert (
            refused.status_code == 422 and "joint.T_parent_lidar of front maps points of 'velodyne'" in refused.text
        )
