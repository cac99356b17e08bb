"""Serial numbers: a calibration of a swapped sensor does not apply, and the answer names the sensor."""

from __future__ import annotations

import pytest

from tests.service.calibrations.test_results import current_address
from tests.service.publications.given import another_rig, publish
from tests.support.uploads import RIG


def state(engineer, rig, **serials):
    etag = engineer.get(f"/rigs/{rig.id}").headers["etag"]
    made = engineer.patch(f"/rigs/{rig.id}/serials", serials, headers={"If-Match": etag})
    assert made.status_code == 200, made.text
    return made.json()


def test_serials_are_stated_with_the_rig_and_corrected(api, fleet, rig, engineer):
    document = {**RIG, "lidar": {**RIG["lidar"], "serial": " L-1 "}, "name": "with serials"}
    document["cameras"] = [{**RIG["cameras"][0], "serial": "C-1"}, *RIG["cameras"][1:]]
    made = engineer.post(f"/vehicles/{rig.vehicle_id}/rigs", document).json()
    assert made["lidar"]["serial"] == "L-1" and made["cameras"][0]["serial"] == "C-1"
    assert state(engineer, rig, cameras={"front": "C-9"})["lidar"]["serial"] is None
    both = state(engineer, rig, lidar="L-9")
    assert both["lidar"]["serial"] == "L-9" and both["cameras"][0]["serial"] == "C-9"
    assert state(engineer, rig, lidar=None)["lidar"]["serial"] is None
    unknown = engineer.patch(f"/rigs/{rig.id}/serials", {"cameras": {"side": "x"}}, headers={"If-Match": '"v4"'})
    assert unknown.json()["code"] == "unknown_camera"
    assert engineer.patch(f"/rigs/{rig.id}/serials", {"lidar": "x"}).status_code == 428
    low = api.member(fleet, "reviewer").patch(f"/rigs/{rig.id}/serials", {}, headers={"If-Match": '"v4"'})
    assert low.status_code == 403


@pytest.mark.parametrize(
    ("swapped", "words"),
    [({"serial": "C-2"}, "camera front with the serial number C-1; the rig 'roof 2' now says C-2"),
     ({"lidar_serial": "L-2"}, "LiDAR of front with the serial number L-1; the rig 'roof 2' now says L-2")],
)  # fmt: skip
def test_a_newer_rig_with_another_sensor_makes_it_not_apply(api, rig, engineer, swapped, words):
    state(engineer, rig, lidar="L-1", cameras={"front": "C-1"})
    given = publish(api, rig, engineer)
    current = engineer.get(current_address(rig)).json()
    assert (current["validity"]["camera_serial"], current["validity"]["lidar_serial"]) == ("C-1", "L-1")
    another_rig(api, rig, "roof 1b", serial="C-1")
    assert engineer.get(current_address(rig)).status_code == 200
    another_rig(api, rig, "roof 2", **swapped)
    for address in (current_address(rig), f"/vehicles/{rig.vehicle_id}/calibration"):
        refused = engineer.get(address)
        assert (refused.status_code, refused.json()["code"]) == (409, "calibration_does_not_apply"), refused.text
        assert words in refused.json()["detail"] and len(refused.json()["swapped"]) == 1
        assert engineer.get(address, params={"format": "opencv"}).status_code == 409
        assert engineer.get(address, params={"as_of": given["published_at"]}).status_code == 200
    # Nor is it published again without a word.
    again = engineer.get(f"/results/{given['result_id']}").json()["objections"]
    assert any(words in one for one in again)
    # A typing mistake is corrected, and it applies again.
    newest = list(engineer.get(f"/vehicles/{rig.vehicle_id}/rigs").json()["items"])[-1]
    etag = {"If-Match": f'"v{newest["version"]}"'}
    body = {"lidar": "L-1", "cameras": {"front": "C-1"}}
    assert engineer.patch(f"/rigs/{newest['id']}/serials", body, headers=etag).status_code == 200
    assert engineer.get(current_address(rig)).status_code == 200


def test_a_car_that_reads_its_sensors_is_told_the_same(api, rig, engineer):
    state(engineer, rig, lidar="L-1", cameras={"front": "C-1"})
    publish(api, rig, engineer)
    address = f"/vehicles/{rig.vehicle_id}/calibration"
    assert engineer.get(address, params={"serial": ["front=C-1", "lidar=L-1"]}).status_code == 200
    for serial in ("front=C-2", "lidar=L=2"):
        refused = engineer.get(address, params={"serial": serial})
        assert refused.json()["code"] == "calibration_does_not_apply" and "the vehicle now says" in refused.text
    assert engineer.get(address, params={"serial": "fornt=C-1"}).json()["code"] == "unknown_sensor"
    for wrong in ("front", "=x", "front="):
        assert engineer.get(address, params={"serial": wrong}).json()["code"] == "invalid_serial"
    twice = engineer.get(address, params={"serial": ["front=C-1", "front=C-2"]})
    assert twice.json()["code"] == "invalid_serial"


def test_without_a_serial_nothing_is_said(api, rig, engineer):
    publish(api, rig, engineer)
    another_rig(api, rig, "roof 2", serial="C-2")
    assert engineer.get(current_address(rig)).status_code == 200
    assert engineer.get(current_address(rig), params={"serial": "front=C-3"}).status_code == 200
