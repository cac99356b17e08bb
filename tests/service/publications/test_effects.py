"""Whatever changes what cars are answered is in the audit, by any way; and who asks before hears the same."""

from __future__ import annotations

import json
from datetime import timedelta

import pytest
from sqlalchemy import delete, select, update
from typer.testing import CliRunner

from service.admin import __main__ as commands
from service.fleets.actions import empty_rig
from service.platform.db.calibrations import Result
from service.platform.db.clock import utc_now
from service.platform.db.effects import effects
from service.platform.db.fleets import Fleet, Rig, RigCamera, Vehicle
from service.platform.db.models import Base
from service.platform.db.people import AuditEntry
from service.platform.db.recordings import Recording
from service.platform.http.router import DRY_RUN
from service.platform.observability.logs import about
from service.publications.actions import hold_to_publish, publish_by_itself
from service.recordings.actions import delete_recording
from service.recordings.retention import delete_overdue
from tests.service.calibrations.test_results import current_address, seed_results
from tests.service.platform.auth.test_every_route import fill, routes, send
from tests.service.publications.given import another_rig, publish, withdraw
from tests.service.publications.test_actions import of_recording
from tests.support.databases import one_database
from tests.support.rows import add
from tests.support.uploads import RIG

DRY = {DRY_RUN: "true"}
SWAPPED, WITHDRAWN = "nothing, a sensor was swapped (409)", "nothing, it was withdrawn (410)"
DELETED = "nothing, it was deleted (410)"


@pytest.fixture
def published(api, rig, reviewer):
    """What the camera `front` is given, with the serial numbers C-1 and L-1; the audit begins after it."""
    with api.database.writing() as session:
        session.get_one(Rig, rig.id).lidar.serial = "L-1"
        session.query(RigCamera).filter_by(rig_id=rig.id).one().serial = "C-1"
    made = publish(api, rig, reviewer)
    forget(api)
    return made


def forget(api):
    with api.database.writing() as session:
        session.execute(delete(AuditEntry))


def lines(api):
    """How each line of the audit came, and its effects without the vehicle's name."""
    with api.database.reading() as session:
        rows = session.scalars(select(AuditEntry).order_by(AuditEntry.id)).all()
    return [
        (row.method, row.path, sorted(line.removeprefix("car, ") for line in (row.effect or "").splitlines()))
        for row in rows
    ]


def patched(actor, path, body, **headers):
    etag = actor.get(path.removesuffix("/serials").removesuffix("/images")).headers["etag"]
    return actor.patch(path, body, headers={"If-Match": etag, **headers})


def test_a_serial_number_takes_it_away_and_says_so_before(api, rig, engineer, published):
    body, path = {"cameras": {"front": "C-2"}}, f"/rigs/{rig.id}/serials"
    another_rig(api, rig, "roof 2", serial="C-1")
    newest = f"/rigs/{list(engineer.get(f'/vehicles/{rig.vehicle_id}/rigs').json()['items'])[-1]['id']}/serials"
    forget(api)
    expected = [
        f"all cameras: front -> {SWAPPED}", "by the sensor C-1: car -> nothing",
        "by the sensor C-2: nothing -> car", f"front: result {published['result_id']} -> {SWAPPED}",
    ]  # fmt: skip
    asked = patched(engineer, newest, body, **DRY)
    assert asked.status_code == 200, asked.text
    assert sorted(line.removeprefix("car, ") for line in asked.json()["effects"]) == expected
    assert engineer.get(current_address(rig)).status_code == 200 and lines(api) == []
    assert patched(engineer, newest, body).status_code == 200
    assert engineer.get(current_address(rig)).status_code == 409
    (line,) = lines(api)
    assert line == ("PATCH", f"/v1{newest}", expected)
    with api.database.reading() as session:
        entry = session.scalars(select(AuditEntry)).one()
        assert entry.person_id == engineer.person_id and entry.request_id and entry.effect.startswith("car, ")
    # What was mistyped is corrected, and that is a line too.
    assert patched(engineer, newest, {"cameras": {"front": "C-1"}}).status_code == 200
    assert f"front: {SWAPPED} -> result {published['result_id']}" in lines(api)[1][2]
    # What changes no answer is none.
    assert patched(engineer, path, {}).status_code == 200 and len(lines(api)) == 2


def test_a_new_rig_with_another_sensor(api, rig, engineer, published):
    path, body = f"/vehicles/{rig.vehicle_id}/rigs", {**RIG, "name": "other"}
    body["cameras"] = [{**RIG["cameras"][0], "name": "front", "serial": "C-2"}]
    asked = engineer.post(path, body, headers=DRY)
    assert f"car, front: result {published['result_id']} -> {SWAPPED}" in asked.json()["effects"], asked.text
    made = engineer.post(path, body)
    assert made.status_code == 201, made.text
    ((method, address, effect),) = lines(api)
    assert (method, address) == ("POST", f"/v1{path}")
    assert f"front: result {published['result_id']} -> {SWAPPED}" in effect
    # And its deletion, which gives it back.
    assert engineer.delete(f"/rigs/{made.json()['id']}").status_code == 204
    assert f"front: {SWAPPED} -> result {published['result_id']}" in lines(api)[1][2]


def test_publishing_aliases_and_withdrawing_are_one_line_each(api, rig, reviewer, published):
    _, (result, _) = seed_results(api, rig)
    for alias in ("current", "canary"):
        assert reviewer.post(f"/results/{result}/publication", {"alias": alias}).status_code == 201
    current = reviewer.get(f"/vehicles/{rig.vehicle_id}/cameras/front/publications").json()["items"][0]
    withdraw(reviewer, current)
    assert [effect for *_, effect in lines(api)] == [
        [f"front: result {published['result_id']} -> result {result}"],
        ["all cameras as canary: nothing -> front", f"front as canary: nothing -> result {result}"],
        [
            f"all cameras as canary: front -> {WITHDRAWN}", f"all cameras: front -> {WITHDRAWN}",
            f"front as canary: result {result} -> {WITHDRAWN}", f"front: result {result} -> {WITHDRAWN}",
        ],
    ]  # fmt: skip


def test_a_recording_is_deleted_with_what_was_published(api, rig, reviewer, engineer):
    recording, result = of_recording(api, rig)
    assert reviewer.post(f"/results/{result}/publication").status_code == 201
    forget(api)
    assert engineer.delete(f"/recordings/{recording}", params={"with_published": True}).status_code == 204
    ((method, _, effect),) = lines(api)
    assert method == "DELETE"
    assert effect == [f"all cameras: front -> {DELETED}", f"front: result {result} -> {DELETED}"]


def test_images_and_names(api, rig, engineer, published):
    changed = patched(engineer, f"/rigs/{rig.id}/images", {"cameras": {"front": {"kind": "raw"}}})
    assert changed.status_code == 200, changed.text
    assert patched(engineer, f"/vehicles/{rig.vehicle_id}", {"name": "lorry"}).status_code == 200
    (_, _, images), (_, _, name) = lines(api)
    assert len(images) == 1 and 'for images {"' in images[0] and '"raw"' in images[0]
    assert name == ["by its name: car -> lorry"]
    assert patched(api.owner(), f"/fleets/{rig.fleet_id}", {"name": "south"}).status_code == 200


def test_cars_that_ask_by_the_fleets_name(api, rig, published):
    owner, path = api.owner(), f"/fleets/{rig.fleet_id}"
    name = owner.get(path).json()["name"]
    question = {"vehicle": "car", "fleet": name}
    assert owner.get("/calibration", params=question).status_code == 200
    expected = [f"by the fleet's name: {name} -> south"]
    assert patched(owner, path, {"name": "south"}, **DRY).json()["effects"] == expected
    assert patched(owner, path, {"name": "south"}).status_code == 200
    assert lines(api) == [("PATCH", f"/v1{path}", expected)]
    assert owner.get("/calibration", params=question).status_code == 404
    # Of another fleet nothing was published.
    assert patched(owner, f"/fleets/{api.fleet()}", {"name": "west"}).status_code == 200
    assert lines(api)[1][2] == []


SEVERAL = "nothing, several vehicles have it (409)"


def test_a_serial_number_of_two_vehicles(api, fleet, rig, engineer, published):
    """Each line says what cars are answered before and after, by whichever vehicle."""

    def answer():
        got = engineer.get("/calibration", params={"sensor": "L-1"}).json()
        return got.get("vehicle") or got["code"]

    assert answer() == "car"
    other = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "other"}).json()["id"]
    body = {**RIG, "lidar": {**RIG["lidar"], "serial": "L-1"}}
    made = engineer.post(f"/vehicles/{other}/rigs", body)
    assert made.status_code == 201 and answer() == "several_vehicles"
    # The car's own sensor is corrected, so the other vehicle has it alone; nothing is published for that one.
    own, others = (f"/rigs/{id}/serials" for id in (rig.id, made.json()["id"]))
    assert patched(engineer, own, {"lidar": "L-2"}).status_code == 200 and answer() == "no_calibration_yet"
    assert patched(engineer, own, {"lidar": "L-1"}).status_code == 200
    asked = patched(engineer, others, {"lidar": None}, **DRY)
    assert asked.json()["effects"] == [f"by the sensor L-1: {SEVERAL} -> car"]
    assert engineer.delete(f"/vehicles/{other}").status_code == 204 and answer() == "car"
    assert [[line for line in effect if "L-1" in line] for *_, effect in lines(api)] == [
        [f"by the sensor L-1: car -> {SEVERAL}"],
        [f"by the sensor L-1: {SEVERAL} -> nothing"],
        [f"by the sensor L-1: nothing -> {SEVERAL}"],
        [f"by the sensor L-1: {SEVERAL} -> car"],
    ]


def test_a_sensor_moves_from_one_vehicle_to_another(api, fleet, rig, engineer, published):
    """In one transaction: neither vehicle had it alone before and after, and it is one line."""
    with api.database.writing() as session:
        other = add(session, Vehicle, session.get_one(Fleet, fleet), name="other")
        add(session, RigCamera, add(session, Rig, other), serial="C-9")
    with api.database.writing() as session:
        for camera in session.scalars(select(RigCamera)):
            camera.serial = {"C-1": "C-9", "C-9": "C-1"}[camera.serial]
    (line,) = lines(api)
    assert {each for each in line[2] if "sensor" in each} == {
        "by the sensor C-1: car -> nothing", "by the sensor C-9: nothing -> car",
    }  # fmt: skip


def test_a_job_publishes(api, rig, published):
    _, (result, _) = seed_results(api, rig)
    with about(job=7, kind="conclude"), api.database.writing() as session:
        row = session.get_one(Result, result)
        calibration = hold_to_publish(session, row)
        assert calibration
        publish_by_itself(session, calibration, row, [])
    assert lines(api) == [("JOB", "conclude 7", [f"front: result {published['result_id']} -> result {result}"])]


def test_a_rig_without_cameras_ends_what_was_withdrawn(api, rig, reviewer, published):
    """Cars are no longer told of a camera that the newest rig of the LiDAR does not carry."""
    withdraw(reviewer, published)
    with api.database.writing() as session:
        session.get_one(Rig, rig.id).lidar.frame = "lidar"
    forget(api)
    with api.database.writing() as session:
        empty_rig(session, session.get_one(Vehicle, rig.vehicle_id), "next")
    assert lines(api) == [("SERVICE", "upkeep", [f"all cameras: {WITHDRAWN} -> nothing"])]


def test_retention_takes_nothing_away_and_would_say_so(api, rig, reviewer):
    recording, result = of_recording(api, rig)
    assert reviewer.post(f"/results/{result}/publication").status_code == 201
    ended = update(Recording).values(retain_until=utc_now() - timedelta(days=1))
    with api.database.writing() as session:
        session.execute(ended)
    forget(api)
    assert delete_overdue(api.database) == 0 and lines(api) == []
    with api.database.writing() as session:
        delete_recording(session, recording, with_published=True)
    ((method, path, effect),) = lines(api)
    assert (method, path) == ("SERVICE", "upkeep") and f"front: result {result} -> {DELETED}" in effect


def test_a_vehicle_goes_with_what_was_withdrawn(api, rig, reviewer, engineer, published):
    withdraw(reviewer, published)
    forget(api)
    gone = engineer.delete(f"/vehicles/{rig.vehicle_id}")
    assert gone.status_code == 204, gone.text
    ((method, _, effect),) = lines(api)
    assert method == "DELETE" and f"front: {WITHDRAWN} -> nothing" in effect


def test_commands_that_end_and_give_credentials(api, fleet):
    person = api.member(fleet, "viewer", "Kim")
    forget(api)

    def typed(*words):
        ended = CliRunner().invoke(commands.app, list(words), prog_name="apexcal admin")
        assert ended.exit_code == 0, ended.output
        return ended.stdout

    typed("users", "link", "Kim")
    (token,) = (one["id"] for one in json.loads(typed("tokens", "list", "--json")) if one["person"] == "Kim")
    typed("tokens", "revoke", token)
    typed("users", "revoke", "Kim")
    assert [(method, path) for method, path, _ in lines(api)] == [
        ("ADMIN", f"users link {person.person_id}"), ("ADMIN", f"tokens revoke {token}"),
        ("ADMIN", f"users revoke {person.person_id}"),
    ]  # fmt: skip
    shown = json.loads(typed("audit", "--json"))
    assert [one["effect"] for one in shown] == ["", "", ""]


def test_a_transaction_that_fails_leaves_no_line(api, rig, published):
    with pytest.raises(ZeroDivisionError), api.database.writing() as session:
        session.get_one(Vehicle, rig.vehicle_id).name = "lorry"
        assert effects(session) == ["car, by its name: car -> lorry"]
        raise ZeroDivisionError
    assert lines(api) == []


@one_database
def test_no_route_changes_anything_when_it_is_only_asked(api, monkeypatch):
    fleet, owner = api.fleet(), api.owner()
    with api.database.writing() as session:
        rows = fill(session, fleet)

    def everything():
        with api.database.reading() as session:
            return {table.name: [tuple(row) for row in session.execute(select(table))] for table in _TABLES}

    before, request, answers = everything(), api.client.request, {}

    def asking(method, path, headers, **body):
        return request(method, path, headers={**headers, **DRY, "If-Match": "*"}, **body)

    monkeypatch.setattr(api.client, "request", asking)
    for method, path, operation in routes():
        if path.startswith("/v1/") and not path.endswith("/events"):
            answers[method, path] = send(api, owner, method, path, operation, rows)
    assert everything() == before
    done = {answer.status_code for (method, _), answer in answers.items() if method == "get"}
    assert not done & {200}, "reading is never only asked"
    tried = [answer for answer in answers.values() if answer.status_code == 200 and "effects" in answer.json()]
    assert len(tried) >= 15


_TABLES = [table for table in Base.metadata.sorted_tables if table.name not in ("heartbeat", "worker")]
