"""The health of a fleet: each camera's state from its checks and publications, in pages, in order, and as CSV."""

from __future__ import annotations

import csv
import io
from datetime import timedelta

import pytest
from sqlalchemy import update

from apexcal.documents.states import CameraState, CameraWork
from service.platform.db.clock import utc_now
from service.platform.db.models import (
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Fleet,
    Publication,
    Recording,
    Result,
    Rig,
    RigCamera,
    Vehicle,
)
from tests.service.calibrations.test_results import seed_results
from tests.service.publications.given import another_rig, publish, withdraw
from tests.service.publications.test_serials import state as state_serials
from tests.support.rows import add


def health(actor, fleet, **params):
    answer = actor.get(f"/fleets/{fleet}/health", params=params)
    assert answer.status_code == 200, answer.text
    return answer.json()


def only(actor, fleet, **params):
    """The one camera of the fleet: what the vehicle gets, and what it waits for."""
    (camera,) = health(actor, fleet, **params)["items"]
    whole = health(actor, fleet)
    assert whole["counts"] == dict.fromkeys(CameraState, 0) | {camera["state"]: 1}
    assert whole["work_counts"] == dict.fromkeys(CameraWork, 0) | {camera["work"]: 1}
    assert health(actor, fleet, work=[camera["work"]])["items"] == [camera]
    assert health(actor, fleet, work=[*{*CameraWork} - {camera["work"]}])["items"] == []
    return camera["state"], camera["work"]


def test_a_camera_goes_through_its_states(api, fleet, rig, engineer, reviewer, viewer):
    assert only(viewer, fleet) == ("none", "recording")
    with api.database.writing() as session:
        walk = add(session, Recording, session.get_one(Rig, rig.id))
        add(session, Recording, session.get_one(Rig, rig.id), state="failed")
    assert only(viewer, fleet) == ("none", "marks")
    (camera,) = health(viewer, fleet)["items"]
    assert camera["recording_id"] == str(walk.id) and camera["vehicle_id"] == str(rig.vehicle_id)
    publication = publish(api, rig, reviewer)
    assert only(viewer, fleet) == ("published", "nothing")
    (camera,) = health(viewer, fleet)["items"]
    assert (camera["verdict"], camera["calibration_id"]) == ("pass", publication["calibration_id"])
    withdraw(reviewer, publication)
    assert only(viewer, fleet) == ("withdrawn", "marks")
    publish(api, rig, reviewer)
    assert only(viewer, fleet) == ("published", "nothing")


def test_what_the_checks_kept_from_being_published_is_to_look_at(api, fleet, rig, reviewer, viewer):
    publication = publish(api, rig, reviewer)
    calibration, _ = seed_results(api, rig)
    later = {"publish": "recommended", "finished_at": utc_now() + timedelta(seconds=9)}
    with api.database.writing() as session:
        session.execute(update(Calibration).where(Calibration.id == calibration).values(**later, state="running"))
    assert only(viewer, fleet) == ("published", "running")
    with api.database.writing() as session:
        session.execute(update(Calibration).where(Calibration.id == calibration).values(state="done"))
    assert only(viewer, fleet) == ("published", "decision")
    assert health(viewer, fleet)["items"][0]["calibration_id"] == str(calibration)
    # That nobody asked to publish it is no doubt about what is published.
    with api.database.writing() as session:
        session.execute(update(Calibration).values(publish="none"))
    assert only(viewer, fleet) == ("published", "nothing")
    withdraw(reviewer, publication)
    with api.database.writing() as session:
        moment = utc_now() + timedelta(seconds=60)
        session.execute(update(Calibration).where(Calibration.id == calibration).values(finished_at=moment))
    assert only(viewer, fleet) == ("withdrawn", "decision")


@pytest.mark.parametrize(
    ("verdict", "decided", "work"),
    [("stop", False, "decision"), ("look", False, "decision"), ("stop", True, "nothing"), (None, False, "decision")],
)
def test_a_published_result_with_failing_checks_is_to_look_at_unless_a_person_decided(
    api, fleet, rig, reviewer, viewer, verdict, decided, work
):
    """A validation on other data may fail after the result was published."""
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(Result).values(verdict=verdict))
        session.execute(update(Publication).values(overridden=["It leans."] if decided else None, reason="Tried."))
    assert only(viewer, fleet) == ("published", work), "cars get it all the same"
    assert health(viewer, fleet)["items"][0]["verdict"] == verdict


@pytest.mark.parametrize("swapped", [{"serial": "C-2"}, {"lidar_serial": "L-2"}])
def test_a_swapped_sensor_is_told_as_the_vehicle_is_told(api, fleet, rig, engineer, reviewer, viewer, swapped):
    state_serials(engineer, rig, lidar="L-1", cameras={"front": "C-1"})
    publish(api, rig, reviewer)
    another_rig(api, rig, "roof 1b", serial="C-1")
    assert only(viewer, fleet) == ("published", "nothing")
    another_rig(api, rig, "roof 2", **swapped)
    assert only(viewer, fleet) == ("published", "recording")
    assert health(viewer, fleet)["items"][0]["is_swapped"]


def test_a_deleted_result_leaves_nothing_published(api, fleet, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(Publication).values(result_id=None))
    assert only(viewer, fleet)[0] == "none"


@pytest.fixture
def many(api, fleet):
    """Vehicles 1 to 12 with two cameras each, some of them published, and one without a rig."""
    with api.database.writing() as session:
        of = session.get_one(Fleet, fleet)
        for number in range(1, 13):
            vehicle = add(session, Vehicle, of, name=f"Van {number}")
            rig = add(session, Rig, vehicle)
            for position, name in enumerate(("front", "rear")):
                add(session, RigCamera, rig, name=name, frame=name, position=position)
            # A later rig that nobody described yet takes the place of none.
            add(session, Rig, vehicle, name="walk of Monday")
            if number % 3 == 0:
                calibration = add(session, Calibration, rig)
                run = add(session, CalibrationRun, calibration, set_id=add(session, CorrespondenceSet, rig).id)
                columns = {"verdict": "pass", "error_20m_mm": float(number)}
                result = add(session, Result, run, **columns)
                add(session, Publication, vehicle, result, led_to=result.id)
        add(session, Vehicle, of, name="=1+2, %_")


ORDERS = ("vehicle", "state", "work", "published_at", "error_20m_mm", "recorded_at")


@pytest.mark.parametrize("order", [*ORDERS, *(f"-{order}" for order in ORDERS)])
def test_pages_follow_each_other_in_every_order(api, fleet, many, viewer, order):
    whole = health(viewer, fleet, order=order)
    assert whole["next"] is None and len(whole["items"]) == 25
    assert whole["counts"] == dict.fromkeys(CameraState, 0) | {"published": 4, "none": 20}
    paged, after = [], {}
    for _ in range(9):
        page = health(viewer, fleet, order=order, limit=3, **after)
        assert page["counts"] == whole["counts"]
        paged += page["items"]
        after = {"after": page["next"]}
    assert after["after"] is None and paged == whole["items"]
    member = {"vehicle": "vehicle"}.get(order.lstrip("-"), order.lstrip("-"))
    values = [item[member] for item in whole["items"] if item[member] is not None]
    if order.endswith("error_20m_mm"):
        assert values == sorted(values, reverse=order[0] == "-") and set(values) == {3.0, 6.0, 9.0, 12.0}
    if order == "vehicle":
        assert list(dict.fromkeys(values))[:4] == ["=1+2, %_", "Van 1", "Van 2", "Van 3"] and values[-1] == "Van 12"
    if order == "state":
        assert values == ["none"] * 20 + ["published"] * 4


def test_text_and_state_narrow_and_the_counts_tell_what_the_text_leaves(api, fleet, many, viewer):
    found = health(viewer, fleet, name="vAN 1", state=["published"])
    assert [item["vehicle"] for item in found["items"]] == ["Van 12"]
    assert found["counts"] == dict.fromkeys(CameraState, 0) | {"published": 1, "none": 7}
    assert {item["camera"] for item in health(viewer, fleet, name="rear")["items"]} == {"rear"}
    (bare,) = health(viewer, fleet, name="%_")["items"]
    assert (bare["camera"], bare["state"], bare["work"]) == (None, None, "recording")
    assert health(viewer, fleet, name="%_")["matching"] == 0, "a vehicle without cameras is no camera"
    waiting = health(viewer, fleet, state=["none"], work=["recording"])
    assert waiting["matching"] == len(waiting["items"]) == 20 and waiting["counts"]["published"] == 0
    assert health(viewer, fleet, work=["decision"])["items"] == []
    nothing = health(viewer, fleet, name="no such")
    assert nothing["items"] == [] and set(nothing["counts"].values()) == {0}
    # Nothing of the page, but the counts.
    assert health(viewer, fleet, state=["withdrawn"])["counts"]["none"] == 20
    for cursor in ("x", "W10=", "WzEsMiwzLDRd"):
        answer = viewer.get(f"/fleets/{fleet}/health", params={"after": cursor})
        assert (answer.status_code, answer.json()["code"]) == (422, "invalid_cursor"), answer.text
    other = health(viewer, fleet, order="state", limit=1)["next"]
    assert viewer.get(f"/fleets/{fleet}/health", params={"after": other}).status_code == 422


def test_csv_has_all_rows_and_no_formula(api, fleet, many, viewer):
    answer = viewer.get(f"/fleets/{fleet}/health", params={"format": "csv", "order": "-error_20m_mm", "limit": 2})
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    assert [row["error_20m_mm"] for row in rows[:5]] == ["12.0", "9.0", "6.0", "3.0", ""] and len(rows) == 25
    assert "'=1+2, %_" in [row["vehicle"] for row in rows]
