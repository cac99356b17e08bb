"""What a filter names, which pairs are taken, and what one request comes to for many vehicles."""

import time
from datetime import UTC, datetime, timedelta
from uuid import UUID, uuid4

import pytest
from sqlalchemy import select, update

from service.fleet_requests.actions import make_parts
from service.platform.db.models import Calibration, CalibrationRun, Fleet, FleetRequest, FleetRequestVehicle, Job
from service.platform.db.session import Database
from service.platform.settings import get_settings
from tests.support.work import work

from .conftest import QUICK, Vans


def sets_of(database: Database, vehicle_id: str) -> list[str]:
    """The sets of a vehicle's newest calibration."""
    with database.reading() as session:
        newest = session.scalars(
            select(Calibration.id).where(Calibration.vehicle_id == UUID(vehicle_id)).order_by(Calibration.id.desc())
        ).first()
        found = session.scalars(select(CalibrationRun.set_id).where(CalibrationRun.calibration_id == newest))
        return [str(one) for one in found]


def test_every_vehicle_that_has_enough_pairs_is_calibrated_as_if_asked_alone(api, vans: Vans):
    good, few, none = vans.add("b good"), vans.add("c few", 5), vans.add("a none", None)
    answer = vans.ask()
    assert answer.status_code == 202, answer.text
    asked = answer.json()
    assert asked["counts"] == {
        "matched": 3, "queued": 1, "running": 0, "done": 0, "failed": 0, "cancelled": 0, "skipped": 2,
    }  # fmt: skip
    assert (asked["state"], asked["asked"]["calibration"]["models"]) == ("running", ["pinhole"])
    assert asked["asked_by"] == "engineer"
    items = vans.engineer.get(f"/fleet-requests/{asked['id']}/vehicles").json()["items"]
    assert [item["vehicle"] for item in items] == ["a none", "b good", "c few"]
    assert [item["problem"] and item["problem"]["code"] for item in items] == ["no_pairs", None, "too_few_pairs"]
    assert [item["state"] for item in items] == ["skipped", "queued", "skipped"]
    assert {items[0]["vehicle_id"], items[2]["vehicle_id"]} == {none["vehicle"], few["vehicle"]}
    of_fleet = vans.engineer.get(f"/calibrations/{items[1]['calibration_id']}").json()
    body = {"correspondence_set_ids": [good["set"]], **QUICK}
    alone = vans.engineer.post(f"/vehicles/{good['vehicle']}/calibrations", body).json()
    assert of_fleet["request"] == alone["request"], "with the same seed, so with the same bits"


def test_the_newest_pairs_of_the_rig_with_the_newest_pairs_are_taken(api, vans: Vans):
    van = vans.add("van")
    second = vans.add_rig(van, "second")
    on_second = vans.mark(second, 40, seed=2)
    vans.ask()
    assert sets_of(api.database, van["vehicle"]) == [on_second]
    newest = vans.mark(van["rig"], 40, seed=3)
    vans.ask()
    assert sets_of(api.database, van["vehicle"]) == [newest]
    vans.ask({"rig": "sec*"})
    assert sets_of(api.database, van["vehicle"]) == [on_second]
    assert vans.mark(van["rig"], 40) == van["set"], "the same pairs are the same set"
    vans.ask()
    assert sets_of(api.database, van["vehicle"]) == [van["set"]], "and newer than what was brought in between"


def test_filters_name_vehicles_by_id_name_and_rig(vans: Vans):
    made = {name: vans.add(name) for name in ("van 1", "van 2", "bus [x] 1", "Van 3")}
    vans.add_rig(made["van 2"], "rear")

    def matched(**vehicles):
        answer = vans.ask(vehicles, dry_run=True)
        return answer.json().get("code") or answer.json()["matched"]

    assert matched() == 4
    assert matched(name="van *") == matched(name="VAN") == 3, "as in the fleet's table: a part, of any case"
    assert matched(name="an 3") == 1 and matched(name="an ?") == "no_vehicle_matches"
    assert matched(name="*[x]*") == 1
    assert matched(name="van ?", rig="rear") == 1
    assert matched(vehicle_ids=[made["van 1"]["vehicle"]]) == 1
    assert matched(name="none") == "no_vehicle_matches"
    assert matched(vehicle_ids=[str(uuid4())]) == "unknown_vehicle"
    assert matched(rig="none", new_pairs=True) == "no_vehicle_matches"
    assert "there are 4." in vans.ask({"name": "none"}).json()["detail"], "all vehicles, not those that are left"


def publish_looks(context, *, value):
    """So few pairs, in the middle of the image, ask for a look."""
    with context.database.writing() as session:
        session.execute(update(Fleet).values(policy={"publish_looks": value}))


def test_filters_know_what_was_calibrated_and_what_is_published(api, vans: Vans, context):
    first, second = vans.add("first", 200), vans.add("second")
    publish_looks(context, value=True)
    vans.ask({"name": "first"}, calibration=QUICK | {"publish": "recommended", "folds": 2})
    work(context)

    def names(**vehicles):
        answer = vans.ask(vehicles, dry_run=True)
        return answer.json().get("code") or answer.json()["matched"]

    day = timedelta(days=1)
    assert names(not_calibrated_since=(datetime.now(UTC) - day).isoformat()) == 1
    assert names(not_calibrated_since=(datetime.now(UTC) + day).isoformat()) == 2
    assert names(new_pairs=True) == 1, "the second, of which nothing is published"
    vans.mark(first["rig"], 40, seed=9)
    assert names(new_pairs=True) == 2
    assert names(new_pairs=True, vehicle_ids=[second["vehicle"]]) == 1


def test_a_quiet_night_is_a_request_that_is_done(api, vans: Vans, context):
    vans.add("van", 200)
    publish_looks(context, value=True)
    asked = vans.ask(calibration=QUICK | {"publish": "recommended", "folds": 2}).json()
    work(context)
    (van,) = vans.engineer.get(f"/fleet-requests/{asked['id']}/vehicles").json()["items"]
    front = van["cameras"]["front"]
    assert front["published"], [(one["name"], one["verdict"], one["sentence"]) for one in front["checks"]]
    assert (front["status"], vans.read(asked)["published"]) == ("ok", 1)
    quiet = vans.ask({"new_pairs": True})
    assert quiet.status_code == 202, quiet.text
    made = quiet.json()
    assert (made["state"], made["counts"]["matched"], made["progress"]["fraction"]) == ("done", 0, 1.0)
    assert made["finished_at"] and vans.states(made) == {}
    assert vans.ask({"name": "nobody", "new_pairs": True}).json()["code"] == "no_vehicle_matches"
    publish_looks(context, value=False)
    unheld = vans.ask(calibration=QUICK | {"publish": "recommended"}).json()
    work(context)
    (van,) = vans.engineer.get(f"/fleet-requests/{unheld['id']}/vehicles").json()["items"]
    assert van["cameras"]["front"]["published"] is False and vans.read(unheld)["published"] == 0
    assert "No pairs were held out." in [one["sentence"] for one in van["cameras"]["front"]["checks"]]


def test_what_is_wrong_with_the_template_refuses_the_whole_and_makes_nothing(api, vans: Vans):
    """Also where the filter leaves nobody."""
    vans.add("van")
    lens = {"width": 640, "height": 480, "distortion_model": "equidistant", "D": [0.0] * 4}
    lens["K"] = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
    is_locked = {"intrinsics_as": "locked"}
    for calibration, code in (
        ({"models": ["fisheye"]}, "unknown_model"),
        ({"locked": {"nonsense": 1.0}}, "unknown_parameter"),
        ({"bounds": {"f_x": [900.0, 300.0]}}, "bounds_inside_out"),
        ({"locked": {"f_x": -400.0}}, "locked_out_of_bounds"),
        ({"intrinsics": {"front": lens | {"distortion_model": "nonsense"}}}, "unknown_distortion_model"),
        ({"intrinsics": {"front": lens | {"K": [0.0] * 9}}}, "invalid_intrinsics"),
        ({"models": ["pinhole"], "intrinsics": {"front": lens}, **is_locked}, "intrinsics_of_another_model"),
        ({"correspondence_set_ids": [str(uuid4())]}, "invalid_request"),
    ):
        for vehicles in ({}, {"name": "nobody"}, {"new_pairs": True}):
            answer = vans.ask(vehicles, calibration=calibration)
            assert (answer.status_code, answer.json()["code"]) == (422, code)
    with api.database.reading() as session:
        assert session.scalars(select(FleetRequest.id)).all() == []
        assert session.scalars(select(Job.id)).all() == []


def test_a_dry_run_says_who_would_be_skipped_and_makes_nothing(api, vans: Vans):
    vans.add("good")
    vans.add("none", None)
    answer = vans.ask(dry_run=True, calibration=QUICK | {"folds": 2})
    assert answer.status_code == 200
    found = answer.json()
    assert (found["matched"], found["calibrations"], found["runs"], found["skipped"]) == (2, 1, 3, 1)
    assert [one["vehicle"] for one in found["skipped_vehicles"]] == ["none"]
    assert [(one["count"], one["examples"]) for one in found["reasons"]] == [(1, ["none"])]
    asked = vans.ask(calibration=QUICK | {"folds": 2}).json()
    assert asked["counts"]["skipped"] == 1 and asked["progress"]["fraction"] == 0.0, "what is skipped is no progress"
    with api.database.reading() as session:
        assert session.scalars(select(FleetRequest.id)).all() == [UUID(asked["id"])], "of the dry run there is none"


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_dry_run_waits_for_no_writer(api, vans: Vans):
    """SQLite has one writer at a time: whoever types a filter must not wait for it, nor be it."""
    vans.add("van")
    with api.database.writing() as session:
        session.execute(update(Fleet).values(version=Fleet.version))
        began = time.monotonic()
        answer = vans.ask(dry_run=True, headers={"Idempotency-Key": "typing"})
        assert time.monotonic() - began < 25, "a writer waits for 30 s"
    assert (answer.status_code, answer.json()["matched"]) == (200, 1)


def test_vehicles_come_in_pages_and_by_state(vans: Vans):
    for name in ("van 10", "Van 2", "van 9"):
        vans.add(name, 40 if name != "van 9" else None)
    asked = vans.ask().json()
    path, names, after = f"/fleet-requests/{asked['id']}/vehicles", [], None
    while True:
        page = vans.engineer.get(path, params={"limit": 2, **({"after": after} if after else {})}).json()
        names += [item["vehicle"] for item in page["items"]]
        after = page["next"]
        if after is None:
            break
    assert names == ["Van 2", "van 9", "van 10"], "as people order names"
    assert vans.states(asked, state="skipped") == {"van 9": "skipped"}
    assert vans.states(asked, state="queued") == {"Van 2": "queued", "van 10": "queued"}
    assert vans.engineer.get(path, params={"state": "nonsense"}).status_code == 422


def test_a_request_that_takes_the_farm_for_days_is_refused(api, vans: Vans, monkeypatch):
    for name in ("van 1", "van 2"):
        vans.add(name)
    body = {"calibration": {"models": ["kannala_brandt"], "folds": 5}}
    found = vans.ask(**body, dry_run=True).json()
    assert (found["runs"], found["calibrations"]) == (12, 2)
    assert 1 <= found["processor_seconds"] / found["runs"] < 10, "some seconds for each run at most"
    monkeypatch.setenv("APEXCAL_FLEET_REQUEST_HOURS", str(0.9 * found["processor_seconds"] / 3600))
    get_settings.cache_clear()
    for dry_run in (True, False):
        refused = vans.ask(**body, dry_run=dry_run)
        assert (refused.status_code, refused.json()["code"]) == (422, "fleet_request_too_large")
        assert "processor hours" in refused.json()["detail"]
    assert vans.ask({"name": "van 1"}, **body).status_code == 202
    with api.database.reading() as session:
        assert len(session.scalars(select(FleetRequest.id)).all()) == 1


def test_a_request_that_cannot_go_on_keeps_no_other_from_it(api, vans: Vans):
    vans.add("a"), vans.add("b")
    broken, whole = (vans.ask({"name": name}).json() for name in ("a", "b"))
    with api.database.writing() as session:
        session.execute(update(FleetRequestVehicle).values(calibration_id=None))
        session.get_one(FleetRequest, UUID(broken["id"])).asked = {}
    make_parts(api.database)
    with api.database.reading() as session:
        columns = (FleetRequestVehicle.fleet_request_id, FleetRequestVehicle.calibration_id)
        begun = dict(iter(session.execute(select(*columns))))
    assert begun[UUID(whole["id"])] is not None and begun[UUID(broken["id"])] is None
