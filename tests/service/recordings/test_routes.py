"""Recordings: lists, edits, frames as byte ranges, and deletion with all that came from them."""

from datetime import timedelta
from uuid import UUID

from sqlalchemy import delete, func, select, update
from sqlalchemy.exc import OperationalError

from service.platform.db.base import new_id
from service.platform.db.clock import now, utc_now
from service.platform.db.models import (
    Answer,
    Apex,
    Base,
    Blob,
    Calibration,
    CalibrationRun,
    CameraFrame,
    CorrespondenceSet,
    Detection,
    Job,
    Publication,
    Recording,
    Result,
    Sensor,
    Slot,
    Vertex,
)
from service.platform.http.problems import Problem
from service.platform.jobs.queue import enqueue
from service.recordings import retention
from service.recordings.actions import delete_recording
from service.recordings.retention import delete_overdue
from tests.service.detections.seeding import answered, seed_recording, seed_rig
from tests.support.people import Api
from tests.support.rows import add
from tests.support.uploads import new_recording, upload

KEPT = {"alembic_version", "fleet", "vehicle", "rig", "rig_camera", "person", "membership", "api_token", "job"}
KEPT |= {"rig_lidar", "job_event", "blob", "audit_entry"}


def add_camera(api: Api, recording: dict, images: list[bytes]) -> Sensor:
    """What ingestion leaves of a camera."""
    key = f"recordings/{recording['id']}/{new_id().hex}"
    api.app.state.store.put_bytes(key, b"head" + b"".join(images))
    stamps = [index * 66_000_000 for index in range(len(images))]
    with api.database.writing() as session:
        row = session.get_one(Recording, UUID(recording["id"]))
        add(session, Blob, key=key)
        sensor = add(session, Sensor, row, blob_key=key, count=len(images), last_ns=stamps[-1])
        offset = 4
        for index, image in enumerate(images):
            where = {"index": index, "stamp_ns": stamps[index], "offset": offset, "length": len(image)}
            add(session, CameraFrame, sensor, **where)
            offset += len(image)
        row.state = "ready"
    return sensor


def test_frames_are_byte_ranges_and_cached_for_ever(api: Api, engineer, recording) -> None:
    images = [f"image {index}".encode() * 50 for index in range(12)]
    add_camera(api, recording, images)
    path = f"/recordings/{recording['id']}/cameras/front/frames"
    page = engineer.get(path, params={"limit": 5}).json()
    assert [one["index"] for one in page["items"]] == [0, 1, 2, 3, 4] and page["next"] == "4"
    assert page["items"][1] == {
        "index": 1,
        "stamp_ns": 66_000_000,
        "media_type": "image/jpeg",
        "width": 640,
        "height": 480,
    }
    assert len(engineer.get(path, params={"limit": 5000}).json()["items"]) == 12
    for index in (0, 7, 11):
        answer = engineer.get(f"{path}/{index}")
        assert answer.content == images[index] and answer.headers["content-type"] == "image/jpeg"
    assert "immutable" in answer.headers["cache-control"] and "private" in answer.headers["cache-control"]
    same = engineer.get(f"{path}/11", headers={"If-None-Match": answer.headers["etag"]})
    assert (same.status_code, same.content) == (304, b"")
    assert engineer.get(f"{path}/0").headers["etag"] != answer.headers["etag"]
    assert engineer.get(f"{path}/12").json()["code"] == "no_such_frame"
    strange = engineer.get(f"/recordings/{recording['id']}/cameras/rear/frames").json()
    assert strange["code"] == "unknown_camera" and "front" in strange["hint"]


def test_lists_are_filtered_and_newest_first(api: Api, engineer, recording) -> None:
    fleet = recording["fleet_id"]
    second = new_recording(engineer, fleet, "later")
    upload(engineer, second["id"], [b"x"])
    listed = engineer.get("/recordings", params={"fleet_id": fleet}).json()["items"]
    assert [one["id"] for one in listed] == [second["id"], recording["id"]]
    assert listed[0]["job"]["kind"] == "ingest" and listed[1]["job"] is None
    by_state = engineer.get("/recordings", params={"state": "queued"}).json()["items"]
    assert [one["id"] for one in by_state] == [second["id"]]
    by_vehicle = engineer.get("/recordings", params={"vehicle_id": recording["vehicle_id"]}).json()["items"]
    assert [one["id"] for one in by_vehicle] == [recording["id"]]
    assert engineer.get("/recordings", params={"state": "odd"}).status_code == 422
    jobs = engineer.get("/jobs", params={"fleet_id": fleet, "state": "queued"}).json()["items"]
    assert [one["id"] for one in jobs] == [listed[0]["job"]["id"]]
    assert engineer.get(f"/jobs/{jobs[0]['id']}").json() == jobs[0]


def test_a_recording_is_edited_on_its_version(engineer, recording) -> None:
    path = f"/recordings/{recording['id']}"
    tag = engineer.get(path).headers["etag"]
    edited = engineer.patch(path, {"marks_per_vertex": 3}, headers={"If-Match": tag})
    assert edited.status_code == 200 and edited.json()["marks_per_vertex"] == 3 and edited.json()["name"] == "drive"
    assert engineer.patch(path, {"name": "n"}, headers={"If-Match": tag}).status_code == 412
    assert engineer.patch(path, {"marks_per_vertex": 0}, headers={"If-Match": tag}).status_code == 422
    # A job's progress changes without the version: a read is never answered 304.
    assert engineer.get(path, headers={"If-None-Match": edited.headers["etag"]}).status_code == 200


def test_what_is_known_of_a_file_is_corrected_until_it_is_read(api: Api, engineer, recording) -> None:
    path = f"/recordings/{recording['id']}"
    known = {"topics": {"cameras": {"front": "/camera/image"}}, "lidar_model": "vlp16", "rings": 16}

    def edit(reading):
        tag = engineer.get(path).headers["etag"]
        return engineer.patch(path, {"reading": reading}, headers={"If-Match": tag})

    assert edit(known).json()["reading"] == known
    assert edit({"rate_hz": 10.0}).json()["reading"] == {"rate_hz": 10.0}
    unknown = edit({"topics": {"cameras": {"rear": "/x"}}})
    assert (unknown.status_code, unknown.json()["code"], unknown.json()["cameras"]) == (
        422,
        "unknown_camera",
        ["front"],
    )
    for wrong in ({"lidar_model": "vlp17"}, {"rings": 0}, {"topics": {"lidar": ""}}, {"topic": {}}):
        assert edit(wrong).json()["code"] == "invalid_request"
    with api.database.writing() as session:
        session.execute(update(Recording).values(state="ready"))
    late = edit(known)
    assert (late.status_code, late.json()["code"]) == (409, "reading_in_use")
    assert engineer.get(path).json()["reading"] == {"rate_hz": 10.0}


def test_a_running_job_says_how_long_it_still_takes(api: Api, engineer, recording) -> None:
    job = upload(engineer, recording["id"], [b"x"]).json()["job"]
    assert job["seconds_left"] is None

    def left(**columns):
        with api.database.writing() as session:
            session.execute(update(Job).values(state="running", **columns))
        return engineer.get(f"/recordings/{recording['id']}").json()["job"]["seconds_left"]

    begun = utc_now() - timedelta(seconds=30)
    shown = left(started_at=begun, progress={"fraction": 0.25, "message": "m"})
    assert 90 <= shown <= round(3 * (utc_now() - begun).total_seconds())
    assert left(started_at=begun, progress={"fraction": 0.25, "message": "m", "seconds_left": 200.4}) == 200
    assert left(started_at=begun, progress={"fraction": 0.001, "message": "m"}) is None
    soon = utc_now() + timedelta(seconds=60)
    assert left(started_at=soon, progress={"fraction": 0.5, "message": "m"}) is None
    assert left(started_at=begun, progress=None) is None


def test_the_original_waits_for_the_upload(engineer, recording) -> None:
    answer = engineer.get(f"/recordings/{recording['id']}/original")
    assert (answer.status_code, answer.json()["code"]) == (409, "upload_open")


def test_a_failed_recording_is_ingested_again(api: Api, engineer, recording) -> None:
    first = upload(engineer, recording["id"], [b"x"]).json()["job"]
    refused = engineer.post(f"/recordings/{recording['id']}/retry")
    assert (refused.status_code, refused.json()["code"]) == (409, "not_failed")
    with api.database.writing() as session:
        session.execute(update(Recording).values(state="failed", problem={"code": "bag_truncated", "detail": "d"}))
        session.execute(update(Job).values(state="failed"))
    shown = engineer.get(f"/recordings/{recording['id']}").json()
    assert shown["problem"]["code"] == "bag_truncated"
    again = engineer.post(f"/recordings/{recording['id']}/retry")
    assert again.status_code == 202, again.text
    assert again.json()["job"]["id"] != first["id"]
    assert (again.json()["recording"]["state"], again.json()["recording"]["problem"]) == ("queued", None)


def calibrated(api: Api, engineer, recording: dict) -> Result:
    """A detection, a mark and a calibration that came from a recording, with their jobs waiting."""
    upload(engineer, recording["id"], [b"one", b"two"])
    sensor = add_camera(api, recording, [b"image"])
    with api.database.writing() as session:
        row = session.get_one(Recording, sensor.recording_id)
        detection, apex = add(session, Detection, row, sensor, state="queued"), add(session, Apex, sensor)
        add(session, Vertex, detection, apex)
        said = answered(row.id, engineer.person_id, sensor.id, 0, "confirmed", (1.0, 2.0))
        add(session, Answer, apex_id=apex.id, **said)
        pairs = add(session, CorrespondenceSet, row, detection, source="annotations")
        calibration = add(session, Calibration, row, state="queued", remaining=1)
        run = add(session, CalibrationRun, calibration, pairs)
        result = add(session, Result, run)
        add(session, Slot, run)
        enqueue(session, kind="detect", fleet_id=row.fleet_id, subject_id=detection.id)
        enqueue(session, kind="solve", fleet_id=row.fleet_id, subject_id=run.id)
    return result


def publish(session, result: Result) -> None:
    calibration = session.get_one(Calibration, result.calibration_id)
    add(session, Publication, calibration, result, led_to=result.id)


def rows(api: Api) -> dict[str, int]:
    with api.database.reading() as session:
        tables = Base.metadata.tables.items()
        counts = {name: session.scalar(select(func.count()).select_from(table)) for name, table in tables}
    return {name: number for name, number in counts.items() if number}


def test_deleting_takes_all_that_came_from_it(api: Api, engineer, recording) -> None:
    other = new_recording(engineer, recording["fleet_id"], "other")
    upload(engineer, other["id"], [b"kept"])
    before = rows(api)
    calibrated(api, engineer, recording)
    assert engineer.delete(f"/recordings/{recording['id']}").status_code == 204
    after = rows(api)
    assert after.pop("recording") == 1 and before.pop("recording") == 2
    assert {name: after[name] for name in after if name not in ("job", "job_event", "blob", "audit_entry")} == {
        name: before[name] for name in before if name not in ("job", "blob")
    }
    with api.database.reading() as session:
        states = dict(session.execute(select(Blob.state, func.count()).group_by(Blob.state)).all())
        jobs = dict(session.execute(select(Job.state, func.count()).group_by(Job.state)).all())
    assert states == {"condemned": 3, "stored": 1} and jobs == {"cancelled": 3, "queued": 1}
    assert engineer.get(f"/recordings/{recording['id']}").status_code == 404
    assert engineer.delete(f"/recordings/{recording['id']}").status_code == 404


def test_a_calibration_in_use_is_not_lost_by_accident(api: Api, engineer, recording) -> None:
    result = calibrated(api, engineer, recording)
    with api.database.writing() as session:
        publish(session, result)
    before = rows(api)
    refused = engineer.delete(f"/recordings/{recording['id']}")
    assert (refused.status_code, refused.json()["code"]) == (409, "calibration_in_use")
    assert "front" in refused.json()["detail"] and rows(api) == before
    assert engineer.get("/jobs", params={"state": "queued"}).json()["items"]
    assert engineer.delete(f"/recordings/{recording['id']}", params={"with_published": True}).status_code == 204
    assert set(rows(api)) <= KEPT | {"publication"}
    with api.database.reading() as session:
        (move,) = session.scalars(select(Publication))
        assert (move.result_id, move.led_to) == (None, result.id), "what the camera was given is remembered"
    address = f"/vehicles/{recording['vehicle_id']}/cameras/front/calibration"
    gone = engineer.get(address)
    assert (gone.status_code, gone.json()["code"]) == (410, "calibration_deleted")


def test_what_was_to_go_goes_by_itself(api: Api, engineer, recording) -> None:
    result = calibrated(api, engineer, recording)
    kept = new_recording(engineer, recording["fleet_id"], "kept", retain_days=1)
    assert kept["retain_until"] > kept["created_at"]
    assert delete_overdue(api.database) == 0
    with api.database.writing() as session:
        late = update(Recording).where(Recording.id == UUID(recording["id"]))
        session.execute(late.values(retain_until=utc_now() - timedelta(seconds=1)))
        publish(session, result)
    for _ in range(2):
        assert delete_overdue(api.database) == 0
    assert len(engineer.get(f"/recordings/{recording['id']}").json()["warnings"]) == 1
    with api.database.writing() as session:
        assert session.scalars(select(Recording.name).where(Recording.kept_until > now(0.9 * 86400.0))).all() == [
            "drive"
        ]
        session.execute(delete(Publication))
    assert delete_overdue(api.database) == 0, "it is looked at again after a day"
    with api.database.writing() as session:
        session.execute(late.values(kept_until=utc_now() - timedelta(seconds=1)))
    assert delete_overdue(api.database) == 1
    assert [one["id"] for one in engineer.get("/recordings").json()["items"]] == [kept["id"]]


def test_what_stays_does_not_keep_the_rest(api: Api, monkeypatch) -> None:
    rig, late = seed_rig(api.database, api.fleet()), utc_now() - timedelta(seconds=1)
    with api.database.writing() as session:
        ids = [add(session, Recording, rig, state="ready", retain_until=late).id for _ in range(101)]

    def delete_only_the_last(session, recording_id, **terms):
        if recording_id == ids[0]:
            raise OperationalError("DELETE", {}, Exception("deadlock detected"))
        if recording_id != ids[-1]:
            raise Problem(409, "calibration_in_use", "It is in use.")
        delete_recording(session, recording_id, **terms)

    monkeypatch.setattr(retention, "delete_recording", delete_only_the_last)
    assert delete_overdue(api.database) == 1


def test_a_recording_without_a_rig_gets_an_empty_one_of_its_name(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "van"}).json()["id"]
    body = {"name": "walk", "file_name": "walk.bag", "reading": {"topics": {"cameras": {"front": "/camera"}}}}
    made = [engineer.post(f"/vehicles/{vehicle}/recordings", body) for _ in range(2)]
    assert [one.status_code for one in made] == [201, 201], made[0].text
    rigs = engineer.get(f"/vehicles/{vehicle}/rigs").json()["items"]
    assert [(rig["id"], rig["name"], rig["cameras"]) for rig in rigs] == [
        (made[0].json()["rig_id"], "walk", []),
        (made[1].json()["rig_id"], "walk 2", []),
    ]


def test_the_rig_of_a_ready_recording_is_replaced_by_one_of_the_same_sensors(api: Api) -> None:
    fleet = api.fleet()
    rig = seed_rig(api.database, fleet)
    recording, camera = seed_recording(api.database, rig, 2)
    with api.database.writing() as session:
        session.get_one(Sensor, camera).facts = {"width": 640, "height": 480}
    engineer = api.member(fleet, "engineer")

    def replaced(**changes):
        described = engineer.get(f"/rigs/{rig.id}").json()
        (one,) = described["cameras"]
        body = {"name": str(changes), "lidar": described["lidar"], "cameras": [one | changes.pop("camera", {})]}
        other = engineer.post(f"/vehicles/{rig.vehicle_id}/rigs", body | changes)
        assert other.status_code == 201, other.text
        version = engineer.get(f"/recordings/{recording}").headers["etag"]
        answer = engineer.patch(
            f"/recordings/{recording}", {"rig_id": other.json()["id"]}, headers={"If-Match": version}
        )
        return answer, other.json()["id"]

    answer, other = replaced(camera={"topic": "/front"})
    assert answer.status_code == 200 and answer.json()["rig_id"] == other and answer.json()["state"] == "ready"
    for changes, says in (
        ({"camera": {"name": "rear"}}, "'rear'"),
        ({"camera": {"topic": "/rear"}}, "/front"),
        ({"camera": {"image_size": [800, 600]}}, "640 x 480"),
        ({"lidar": {"frame": "velodyne", "topic": "/other"}}, "/lidar"),
    ):
        answer, _ = replaced(**changes)
        assert (answer.status_code, answer.json()["code"]) == (409, "sensors_differ") and says in answer.text
