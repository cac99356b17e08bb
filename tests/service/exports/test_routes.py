"""Exports over HTTP: by ``format`` and by Accept, of what is published and of any result."""

from __future__ import annotations

import io
import json
import zipfile

import pytest
import yaml
from sqlalchemy import update

from service.platform.db.calibrations import Result
from service.platform.db.fleets import RigCamera
from tests.service.calibrations.test_results import current_address
from tests.support.databases import one_database

pytestmark = one_database

URDF = (
    '<robot name="car"><link name="velodyne"/><link name="camera_front_optical"/>\n<joint name="mount" type="fixed">'
    '<parent link="velodyne"/><child link="camera_front_optical"/><origin xyz="1 1 1"/></joint></robot>'
)


def test_what_is_published_comes_in_every_format(fleet, rig, result, viewer):
    table = viewer.get("/export-formats").json()
    assert {"kalibr", "urdf", "ros2", "nuscenes"} <= {one["name"] for one in table}
    for one in table:
        by_name = viewer.get(current_address(rig), params={"format": one["name"]})
        by_type = viewer.get(current_address(rig), headers={"Accept": f"{one['media_type']}, */*;q=0.1"})
        of_result = viewer.get(f"/results/{result}", params={"format": one["name"]})
        assert [answer.status_code for answer in (by_name, by_type, of_result)] == [200] * 3, by_name.text
        assert by_name.content == by_type.content == of_result.content
        assert by_name.headers["content-type"].startswith(one["media_type"] + "+")
        assert by_name.headers["content-disposition"].startswith('attachment; filename="car-front-' + one["name"])
        again = viewer.get(
            current_address(rig), params={"format": one["name"]}, headers={"If-None-Match": by_name.headers["etag"]}
        )
        assert again.status_code == 304 and not again.content
    tags = [viewer.get(current_address(rig), params={"format": one["name"]}).headers["etag"] for one in table]
    assert len(set(tags)) == len(tags)


def test_one_file_comes_as_it_is_and_several_as_a_zip(fleet, rig, result, viewer):
    lens = yaml.safe_load(viewer.get(current_address(rig), params={"format": "camera_info"}).content)
    assert lens["camera_matrix"]["data"] == [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]
    assert (lens["image_width"], lens["image_height"], lens["camera_name"]) == (640, 480, "front")
    several = viewer.get(current_address(rig), params={"format": "nuscenes"})
    with zipfile.ZipFile(io.BytesIO(several.content)) as archive:
        lidar, camera = json.loads(archive.read("calibrated_sensor.json"))
    assert lidar["translation"] == [1.0, 0.0, 2.0] and lidar["rotation"] == [1.0, 0.0, 0.0, 0.0]
    # The camera at (0.2, 0, -0.1) before the LiDAR.
    assert camera["translation"] == pytest.approx([1.2, 0.0, 1.9])


def test_json_is_what_is_answered_otherwise(fleet, rig, result, viewer):
    plain = viewer.get(current_address(rig)).json()
    for options in ({"params": {"format": "json"}}, {"headers": {"Accept": "text/html, application/yaml"}}):
        assert viewer.get(current_address(rig), **options).json() == plain


def test_an_unknown_format_and_one_that_cannot_carry_it(api, fleet, rig, result, viewer):
    unknown = viewer.get(current_address(rig), params={"format": "xyz"})
    assert (unknown.status_code, unknown.json()["code"]) == (422, "unknown_format")
    assert "kalibr" in unknown.json()["hint"] and "json" in unknown.json()["formats"]
    with api.database.writing() as session:
        row = session.get_one(Result, result)
        lens = row.document["intrinsics"] | {f"k{place}": 0.01 for place in range(1, 6)} | {"skew": 0.02}
        row.model, row.document = "brown_conrady", row.document | {"intrinsics": lens}
    refused = viewer.get(current_address(rig), params={"format": "kalibr"})
    assert (refused.status_code, refused.json()["code"]) == (406, "format_cannot_carry")
    assert refused.json()["formats"] == ["json", "urdf", "openlabel", "vcd"]
    assert refused.headers["content-type"] == "application/problem+json"


def test_a_vehicles_own_urdf_comes_back_with_one_joint_changed(fleet, rig, result, viewer):
    asked = {"urdf": URDF, "joint": "mount"}
    for address in (f"{current_address(rig)}/urdf", f"/results/{result}/urdf"):
        answer = viewer.post(address, asked)
        assert answer.status_code == 200, answer.text
        head, tail = URDF.split('<origin xyz="1 1 1"/>')
        text = answer.content.decode()
        assert text.startswith(head) and text.endswith(tail) and 'xyz="0.2 0.0 -0.1"' in text
    other = viewer.post(f"{current_address(rig)}/urdf", asked | {"camera_link": "eye"})
    assert (other.status_code, other.json()["code"]) == (422, "urdf_not_read")
    large = viewer.post(f"{current_address(rig)}/urdf", asked | {"urdf": URDF + " " * 300_000})
    assert large.status_code == 413


def test_autowares_own_file_comes_back_with_one_pose_changed(api, fleet, rig, result, viewer):
    """Without a joint in the rig the problem says how to state it."""
    asked = {"urdf": "# ours\nsensor_kit_base_link:\n  front/camera_link: {x: 1}\n", "joint": "front/camera_link"}
    refused = viewer.post(f"{current_address(rig)}/urdf", asked)
    assert (refused.status_code, refused.json()["code"]) == (422, "autoware_not_read")
    assert "--rig-out" in refused.json()["hint"]
    level = {"to_frame": "sensor_kit_base_link", "rotation": {"quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}}
    body = {"from_frame": "camera_front_optical", "rotation": {"quaternion_xyzw": [-0.5, 0.5, -0.5, 0.5]}}
    joint = {
        "T_parent_lidar": level | {"from_frame": "velodyne", "translation_m": [0.0, 0.0, 0.5]},
        "T_child_camera": body | {"to_frame": "front/camera_link", "translation_m": [0.0, 0.0, 0.0]},
    }
    with api.database.writing() as session:
        session.execute(update(RigCamera).values(joint=joint))
    numbers = "".join(f"    {name}: 1\n" for name in ("x", "y", "z", "roll", "pitch", "yaw"))
    file = f"# ours\nsensor_kit_base_link:\n  front/camera_link: # left\n{numbers}  gnss_link: {{x: 1}}\n"
    answer = viewer.post(f"{current_address(rig)}/urdf", asked | {"urdf": file})
    assert answer.status_code == 200 and answer.headers["content-type"].startswith("application/yaml"), answer.text
    pose = yaml.safe_load(answer.text)["sensor_kit_base_link"]
    assert pose.pop("gnss_link") == {"x": 1} and "# left" in answer.text
    assert list(pose["front/camera_link"].values()) == pytest.approx([0.2, 0.0, 0.4, 0.0, 0.0, 0.0], abs=1e-12)
