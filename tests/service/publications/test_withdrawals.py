"""A withdrawn publication: nothing is given until something is published, and everything says so."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import delete, select

from service.platform.db.calibrations import Calibration, Publication, Result
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.publications import routes
from tests.service.calibrations.test_results import FOUND, NEWER, current_address, failed, seed_results
from tests.service.publications.given import history, publish, same_moment, withdraw
from tests.support.rows import LEVEL, make


def addresses(rig):
    return (current_address(rig), f"/vehicles/{rig.vehicle_id}/calibration")


def test_the_one_before_does_not_come_back_by_itself(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    etags = [viewer.get(one).headers["etag"] for one in addresses(rig)]
    made = withdraw(reviewer, newer)
    assert made["published_by"] == "Rea" and made["reason"] == "It pulls to the left."
    assert made["result_id"] is None and made["led_to"] is None and not made["is_current"]
    for address, etag in zip(addresses(rig), etags, strict=True):
        for headers in ({}, {"If-None-Match": etag}):
            gone = viewer.get(address, headers=headers)
            assert (gone.status_code, gone.json()["code"]) == (410, "calibration_withdrawn"), gone.text
            assert "by Rea" in gone.json()["detail"] and "It pulls to the left." in gone.json()["detail"]
            assert [one["camera"] for one in gone.json()["withdrawn"]] == ["front"]
        assert viewer.get(address, params={"format": "opencv"}).status_code == 410
    body = {"urdf": "<robot/>", "joint": "j"}
    assert viewer.post(current_address(rig) + "/urdf", body).status_code == 410
    # A moment before, it was given.
    then = viewer.get(addresses(rig)[1], params={"as_of": newer["published_at"]}).json()["cameras"]["front"]
    assert then["publication_id"] == newer["id"]
    assert same_moment(then["validity"]["until"], made["published_at"])
    assert viewer.get(addresses(rig)[1], params={"as_of": made["published_at"]}).status_code == 410
    assert [one["is_current"] for one in history(viewer, rig)] == [False, False, False]
    # The way back: the older one again, with a reason.
    back = reviewer.post(f"/results/{older['result_id']}/publication", {"reason": "The newer one is off."})
    assert back.status_code == 201, back.text
    assert viewer.get(current_address(rig)).json()["result_id"] == older["result_id"]
    rows = history(viewer, rig)
    assert [one["result_id"] for one in rows] == [older["result_id"], None, newer["result_id"], older["result_id"]]
    assert [one["is_current"] for one in rows] == [True, False, False, False]


def test_a_withdrawn_result_is_given_again_by_an_override_only(api, rig, reviewer, viewer):
    only = publish(api, rig, reviewer)
    withdraw(reviewer, only)
    again = f"/results/{only['result_id']}/publication"
    refused = reviewer.post(again, {"reason": "It was the tyre."})
    assert refused.json()["code"] == "checks_stop"
    assert failed(refused.json())[0].startswith("It was withdrawn (") and "left." in refused.json()["detail"]
    assert reviewer.post(again, {"override": {"reason": "It was the tyre."}}).status_code == 201
    assert viewer.get(current_address(rig)).status_code == 200
    with api.database.reading() as session:
        assert [row.number for row in session.scalars(select(Publication).order_by(Publication.number))] == [1, 2, 3]


def test_twice_is_once(api, rig, reviewer):
    given = publish(api, rig, reviewer)
    address = f"/publications/{given['id']}/withdrawal"
    assert reviewer.post(address, {}).status_code == 422
    first = withdraw(reviewer, given)
    again = reviewer.post(address, {"reason": "Another."})
    assert (again.status_code, again.json()) == (200, first)
    with api.database.reading() as session:
        assert len(session.scalars(select(Publication)).all()) == 2


def test_what_the_camera_is_no_longer_given_cannot_be_withdrawn(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    refused = reviewer.post(f"/publications/{older['id']}/withdrawal", {"reason": "The mast was bent."})
    assert (refused.status_code, refused.json()["code"]) == (409, "not_current")
    assert viewer.get(current_address(rig)).json()["publication_id"] == newer["id"]
    gone = withdraw(reviewer, newer)
    refused = reviewer.post(f"/publications/{gone['id']}/withdrawal", {"reason": "Again."})
    assert (refused.status_code, refused.json()["code"]) == (409, "not_current")
    assert failed(reviewer.get(f"/results/{older['result_id']}").json()) == []


def delete_of(api, publication):
    """Delete the publication's result with its calibration."""
    with api.database.writing() as session:
        found = session.get_one(Result, UUID(publication["result_id"]))
        session.execute(delete(Calibration).where(Calibration.id == found.calibration_id))


def test_deleting_what_was_withdrawn_does_not_bring_back_the_one_before(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    gone = withdraw(reviewer, newer)
    delete_of(api, newer)
    assert [one["id"] for one in history(viewer, rig)] == [gone["id"], newer["id"], older["id"]]
    assert viewer.get(current_address(rig)).json()["code"] == "calibration_withdrawn"
    newest = publish(api, rig, reviewer)
    assert viewer.get(current_address(rig)).json()["publication_id"] == newest["id"]


def test_deleting_what_is_given_does_not_bring_back_the_one_before(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    etags = [viewer.get(one).headers["etag"] for one in addresses(rig)]
    delete_of(api, newer)
    for address, etag in zip(addresses(rig), etags, strict=True):
        gone = viewer.get(address, headers={"If-None-Match": etag})
        assert (gone.status_code, gone.json()["code"]) == (410, "calibration_deleted"), gone.text
        assert [one["result_id"] for one in gone.json()["deleted"]] == [newer["result_id"]]
    first, second = history(viewer, rig)
    assert (first["result_id"], first["led_to"], first["is_current"]) == (None, newer["result_id"], False)
    refused = reviewer.post(f"/publications/{newer['id']}/withdrawal", {"reason": "It is gone."})
    assert (refused.status_code, refused.json()["code"]) == (409, "not_current")
    back = reviewer.post(f"/results/{older['result_id']}/publication", {"reason": "The other one is gone."})
    assert back.status_code == 201 and second["id"] == older["id"]
    assert viewer.get(current_address(rig)).json()["result_id"] == older["result_id"]


def test_what_was_withdrawn_is_no_measure_of_what_comes(api, rig, reviewer):
    """A result is compared with the current one, but not with a withdrawn one."""
    good = publish(api, rig, reviewer)
    _, (worse, _) = seed_results(api, rig, found=FOUND | {"heldout_mean_px": 2.0})
    assert failed(reviewer.get(f"/results/{worse}").json()) == [NEWER]
    withdraw(reviewer, good)
    assert failed(reviewer.get(f"/results/{worse}").json()) == []


def test_what_is_deleted_at_this_moment_is_not_found(api, rig, reviewer, monkeypatch):
    given = publish(api, rig, reviewer)

    def hold(session, vehicle_id):
        session.execute(delete(Vehicle).where(Vehicle.id == vehicle_id).execution_options(synchronize_session=False))

    monkeypatch.setattr(routes, "hold_publications", hold)
    answer = reviewer.post(f"/publications/{given['id']}/withdrawal", {"reason": "x"})
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


def test_a_withdrawn_camera_that_is_no_longer_mounted_does_not_hold_the_vehicle_up(api, rig, reviewer, viewer):
    withdraw(reviewer, publish(api, rig, reviewer))
    address = f"/vehicles/{rig.vehicle_id}/calibration"
    assert viewer.get(address).status_code == 410
    with api.database.writing() as session:
        newer = make(Rig, fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, name="new")
        session.add(newer)
        session.flush()
        session.add(
            RigCamera(
                rig_id=newer.id, position=0, name="rear", frame="rear", image_width=640, image_height=480,
                nominal=LEVEL, bounds={},
            )
        )  # fmt: skip
    refused = viewer.get(address)
    assert (refused.status_code, refused.json()["code"]) == (404, "no_calibration_yet")
    assert viewer.get(address, params={"camera": "front"}).status_code == 410
    assert viewer.get(current_address(rig)).status_code == 410
