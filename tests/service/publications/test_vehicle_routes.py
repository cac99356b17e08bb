"""A whole vehicle in one answer: its cameras now and at a moment, narrowed, and in other formats."""

from __future__ import annotations

import pytest

from service.platform.db.calibrations import Calibration, CalibrationRun, Result
from service.platform.db.fleets import RigCamera
from tests.service.calibrations.test_results import T_VEHICLE_LIDAR, current_address, seed_results
from tests.service.detections.seeding import seed_rig
from tests.support.rows import add


@pytest.fixture
def rig(api, fleet):
    rig = seed_rig(api.database, fleet, T_vehicle_lidar=T_VEHICLE_LIDAR)
    with api.database.writing() as session:
        add(session, RigCamera, rig, position=1, name="rear", frame="camera_rear_optical")
    return rig


def address(rig):
    return f"/vehicles/{rig.vehicle_id}/calibration"


def published(api, rig, reviewer, camera="front"):
    calibration, (result, _) = seed_results(api, rig)
    if camera != "front":
        with api.database.writing() as session:
            row = session.get_one(Result, result)
            mount = row.document["transform"] | {"to_frame": "camera_rear_optical", "translation_m": [0.0, 0.4, 0.1]}
            row.camera, row.document = camera, row.document | {"transform": mount}
            session.get_one(CalibrationRun, row.run_id).camera = camera
            made = session.get_one(Calibration, calibration)
            made.summary = made.summary | {"cameras": {camera: made.summary["cameras"]["front"]}}
    given = reviewer.post(f"/results/{result}/publication")
    assert given.status_code == 201, given.text
    return given.json()


def test_an_id_in_a_strange_form_is_refused_with_and_without_a_query(api, fleet, rig):
    viewer, plain = api.member(fleet, "viewer"), rig.vehicle_id.hex
    for strange in (f"{plain[0]}-{plain[1:]}", f"{plain[:30]}_{plain[31]}", "\u0661" * 32):
        for query in ("", "?alias=current"):
            assert viewer.get(f"/vehicles/{strange}/calibration{query}").status_code == 422
    for known in (plain, str(rig.vehicle_id).upper()):
        assert viewer.get(f"/vehicles/{known}/calibration").json()["code"] == "no_calibration_yet"


def test_all_cameras_come_at_once_and_each_as_at_its_own_address(api, fleet, rig, reviewer, viewer):
    none = viewer.get(address(rig))
    assert (none.status_code, none.json()["code"]) == (404, "no_calibration_yet")
    published(api, rig, reviewer)
    part = viewer.get(address(rig))
    assert part.json()["without"] == ["rear"] and list(part.json()["cameras"]) == ["front"]
    published(api, rig, reviewer, "rear")
    whole = viewer.get(address(rig))
    assert whole.json()["without"] == [] and whole.json()["vehicle_id"] == str(rig.vehicle_id)
    for camera, document in whole.json()["cameras"].items():
        assert document == viewer.get(current_address(rig).replace("front", camera)).json()
    assert part.headers["etag"] != whole.headers["etag"]
    again = viewer.get(address(rig), headers={"If-None-Match": whole.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    rear = viewer.get(address(rig), params={"camera": "rear"})
    assert list(rear.json()["cameras"]) == ["rear"] and rear.headers["etag"] != whole.headers["etag"]
    unknown = viewer.get(address(rig), params={"camera": ["rear", "side"]})
    assert unknown.status_code == 404 and "'side'" in unknown.json()["detail"]


def test_what_it_was_given_at_a_moment(api, fleet, rig, reviewer, viewer):
    first = published(api, rig, reviewer)
    other = published(api, rig, reviewer, "rear")
    last = published(api, rig, reviewer)

    def at(moment):
        answer = viewer.get(address(rig), params={"as_of": moment})
        return {name: one["publication_id"] for name, one in answer.json().get("cameras", {}).items()}

    assert at(first["published_at"]) == {"front": first["id"]}
    assert at(other["published_at"]) == {"front": first["id"], "rear": other["id"]}
    assert at(last["published_at"]) == {"front": last["id"], "rear": other["id"]}
    assert at("2020-01-01T00:00:00Z") == {}
    assert viewer.get(address(rig), params={"as_of": "2020-01-01"}).status_code == 422


def test_both_cameras_in_one_file_of_another_program(api, fleet, rig, reviewer, viewer):
    published(api, rig, reviewer)
    published(api, rig, reviewer, "rear")
    chain = viewer.get(address(rig), params={"format": "kalibr"})
    assert chain.status_code == 200 and 'filename="car-kalibr.yaml"' in chain.headers["content-disposition"]
    assert "cam1:" in chain.text and "T_cn_cnm1:" in chain.text
    assert viewer.get(address(rig), params={"format": "xyz"}).json()["code"] == "unknown_format"
