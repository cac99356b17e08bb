"""A withdrawn publication: nothing is given until something is published, and everything says so."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import delete, select, update

from service.calibrations import publication_routes
from service.db.aliases import Withdrawal
from service.db.calibrations import Calibration, Publication, Result
from service.db.fleets import Rig, RigCamera
from tests.service.calibrations.given import history, publish, same_moment, withdraw
from tests.service.calibrations.test_results import FOUND, current_address, seed_results
from tests.service.detections.seeding import LEVEL


def addresses(rig):
    return (current_address(rig), f"/vehicles/{rig.vehicle_id}/calibration")


def test_the_one_before_does_not_come_back_by_itself(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    etags = [viewer.get(one).headers["etag"] for one in addresses(rig)]
    made = withdraw(reviewer, newer)
    assert made["withdrawn"]["withdrawn_by"] == "Rea" and made["withdrawn"]["reason"] == "It pulls to the left."
    assert not made["is_current"]
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
    assert same_moment(then["validity"]["until"], made["withdrawn"]["withdrawn_at"])
    at = made["withdrawn"]["withdrawn_at"]
    assert viewer.get(addresses(rig)[1], params={"as_of": at}).status_code == 410
    assert [one["is_current"] for one in history(viewer, rig)] == [False, False]
    # The way back: the older one again, with a reason.
    back = reviewer.post(f"/results/{older['result_id']}/publication", {"reason": "The newer one is off."})
    assert back.status_code == 201, back.text
    assert viewer.get(current_address(rig)).json()["result_id"] == older["result_id"]
    rows = history(viewer, rig)
    assert [one["result_id"] for one in rows] == [older["result_id"], newer["result_id"], older["result_id"]]
    assert [one["withdrawn"] is not None for one in rows] == [False, True, False] and rows[0]["is_current"]


def test_a_withdrawn_result_is_given_again_by_an_override_only(api, rig, reviewer, viewer):
    only = publish(api, rig, reviewer)
    withdraw(reviewer, only)
    again = f"/results/{only['result_id']}/publication"
    refused = reviewer.post(again, {"reason": "It was the tyre."})
    assert refused.json()["code"] == "objections"
    assert refused.json()["objections"][0].startswith("It was withdrawn (") and "left." in refused.json()["detail"]
    assert reviewer.post(again, {"override": {"reason": "It was the tyre."}}).status_code == 201
    assert viewer.get(current_address(rig)).status_code == 200
    with api.database.reading() as session:
        assert [row.number for row in session.scalars(select(Publication).order_by(Publication.number))] == [1, 2]


def test_twice_is_once_and_only_reviewers_may(api, fleet, rig, reviewer, viewer):
    given = publish(api, rig, reviewer)
    address = f"/publications/{given['id']}/withdrawal"
    assert viewer.post(address, {"reason": "x"}).status_code == 403
    assert api.member(api.fleet(), "admin").post(address, {"reason": "x"}).status_code == 404
    assert reviewer.post(address, {}).status_code == 422
    first = withdraw(reviewer, given)
    again = reviewer.post(address, {"reason": "Another."})
    assert (again.status_code, again.json()) == (200, first)
    with api.database.reading() as session:
        assert len(session.scalars(select(Withdrawal)).all()) == 1


def test_one_that_is_not_current_can_be_withdrawn_and_changes_nothing_for_cars(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    withdraw(reviewer, older)
    assert viewer.get(current_address(rig)).json()["publication_id"] == newer["id"]
    assert [one["is_current"] for one in history(viewer, rig)] == [True, False]
    against = reviewer.get(f"/results/{older['result_id']}").json()["objections"]
    assert any(one.startswith("It was withdrawn") for one in against)
    then = viewer.get(addresses(rig)[1], params={"as_of": newer["published_at"]}).json()["cameras"]["front"]
    assert then["publication_id"] == newer["id"] and then["validity"]["until"] is None


def test_deleting_what_was_withdrawn_does_not_bring_back_the_one_before(api, rig, reviewer, viewer):
    older, newer = publish(api, rig, reviewer), publish(api, rig, reviewer)
    withdraw(reviewer, newer)
    with api.database.writing() as session:
        session.execute(delete(Calibration).where(Calibration.id == select(Result.calibration_id).where(
            Result.id == UUID(newer["result_id"])).scalar_subquery()))  # fmt: skip
    assert [one["id"] for one in history(viewer, rig)] == [older["id"]]
    assert viewer.get(current_address(rig)).json()["code"] == "calibration_withdrawn"
    # The next publication is newer than what was withdrawn, though that number is free again.
    newest = publish(api, rig, reviewer)
    assert viewer.get(current_address(rig)).json()["publication_id"] == newest["id"]


def test_rows_of_an_older_version_are_numbered_and_withdrawn(api, rig, reviewer, viewer):
    first, second = publish(api, rig, reviewer), publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(Publication).where(Publication.id == UUID(second["id"])).values(number=None))
    withdraw(reviewer, second)
    assert viewer.get(current_address(rig)).json()["code"] == "calibration_withdrawn"
    # An older process publishes beside us: it numbers nothing, and what it publishes is the newest.
    _, (result, _) = seed_results(api, rig)
    with api.database.writing() as session:
        of = session.scalars(select(Publication)).first()
        session.add(Publication(fleet_id=of.fleet_id, vehicle_id=of.vehicle_id, camera="front", result_id=result))
    assert viewer.get(current_address(rig)).json()["result_id"] == str(result)
    assert [one["withdrawn"] is not None for one in history(viewer, rig)] == [False, True, False]
    assert first["id"] == history(viewer, rig)[2]["id"]


def test_what_was_withdrawn_is_no_measure_of_what_comes(api, rig, reviewer):
    """A result with twice the held-out error is worse than the current one, but not than a withdrawn one."""
    good = publish(api, rig, reviewer)
    _, (worse, _) = seed_results(api, rig, found=FOUND | {"heldout_mean_px": 2.0})
    assert "Held-out pairs lie" in reviewer.get(f"/results/{worse}").json()["objections"][0]
    withdraw(reviewer, good)
    assert reviewer.get(f"/results/{worse}").json()["objections"] == []


def test_a_row_of_an_older_version_does_not_take_the_number_of_what_was_withdrawn(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    newer = publish(api, rig, reviewer)
    withdraw(reviewer, newer)
    with api.database.writing() as session:
        of = session.get_one(Publication, UUID(newer["id"]))
        session.execute(
            delete(Calibration).where(Calibration.id == session.get_one(Result, of.result_id).calibration_id)
        )
    _, (result, _) = seed_results(api, rig)
    with api.database.writing() as session:
        session.add(Publication(fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, camera="front", result_id=result))
    unnumbered = history(viewer, rig)[0]
    assert unnumbered["result_id"] == str(result) and unnumbered["is_current"]
    assert withdraw(reviewer, unnumbered)["withdrawn"]["reason"] == "It pulls to the left."
    assert viewer.get(current_address(rig)).json()["code"] == "calibration_withdrawn"


def test_what_is_deleted_at_this_moment_is_not_found(api, rig, reviewer, monkeypatch):
    given = publish(api, rig, reviewer)

    def hold(session, vehicle_id):
        session.execute(delete(Publication).execution_options(synchronize_session=False))

    monkeypatch.setattr(publication_routes, "hold_publications", hold)
    answer = reviewer.post(f"/publications/{given['id']}/withdrawal", {"reason": "x"})
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


def test_a_withdrawn_camera_that_is_no_longer_mounted_does_not_hold_the_vehicle_up(api, rig, reviewer, viewer):
    withdraw(reviewer, publish(api, rig, reviewer))
    address = f"/vehicles/{rig.vehicle_id}/calibration"
    assert viewer.get(address).status_code == 410
    with api.database.writing() as session:
        newer = Rig(fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, name="new", lidar_frame=rig.lidar_frame)
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
