"""What cars ask at every start: fresh on every process, for those who may see it now, by id, name or sensor."""

from __future__ import annotations

import logging
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from hashlib import sha256
from uuid import UUID

import httpx
from sqlalchemy import delete, update

from service.platform.auth.credential_actions import new_secret, secret_hash
from service.platform.db.calibrations import Calibration, Result
from service.platform.db.clock import utc_now
from service.platform.db.fleets import Fleet, Rig, RigCamera, RigLidar, Vehicle
from service.platform.db.people import ApiToken, BrowserSession, Membership
from service.publications import retrieval
from tests.service.detections.seeding import seed_rig
from tests.service.publications.given import another_rig, publish, withdraw
from tests.support.people import Actor
from tests.support.results import model_summary, summary


def address(rig):
    return f"/vehicles/{rig.vehicle_id}/calibration"


def test_another_process_answers_with_what_was_published_a_moment_ago(make_api, api, rig, reviewer, viewer):
    there = Actor(viewer.person_id, viewer.token, make_api().client)
    for _ in range(5):
        given = publish(api, rig, reviewer)
        for asked in (viewer, there):
            answer = asked.get(address(rig))
            assert answer.json()["cameras"]["front"]["publication_id"] == given["id"]
            etag = {"If-None-Match": answer.headers["etag"]}
            assert asked.get(address(rig), headers=etag).status_code == 304
            assert there.get(address(rig), headers=etag).status_code == 304
    withdraw(reviewer, given)
    assert [one.get(address(rig), headers=etag).status_code for one in (viewer, there)] == [410, 410]
    with api.database.writing() as session:
        session.execute(update(Vehicle).values(name="renamed", version=2))
    assert publish(api, rig, reviewer)
    assert there.get(address(rig)).json()["vehicle"] == "renamed"


def test_an_etag_is_of_one_question(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    asked = [{}, {"camera": "front"}, {"serial": "front=x"}, {"format": "opencv"}, {"as_of": "2100-01-01T00:00:00Z"}]
    etags = [viewer.get(address(rig), params=one).headers["etag"] for one in asked]
    assert len(set(etags)) == len(asked)
    for question, etag in zip(asked, etags, strict=True):
        for tag in (etag, f"W/{etag}", f'"other", {etag}', "*"):
            again = viewer.get(address(rig), params=question, headers={"If-None-Match": tag})
            assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", etag)
        assert viewer.get(address(rig), params=question, headers={"If-None-Match": '"x"'}).status_code == 200
    withheld = viewer.get(address(rig), params={"camera": "rear"}, headers={"If-None-Match": "*"})
    assert withheld.json()["code"] == "no_calibration_yet"
    # A serial number that the rig learns of makes the same question another one.
    with api.database.writing() as session:
        session.execute(update(RigCamera).values(serial="C-1"))
        session.execute(update(Rig).values(version=2))
    refused = viewer.get(address(rig), params=asked[2], headers={"If-None-Match": etags[2]})
    assert refused.json()["code"] == "calibration_does_not_apply"


def test_an_answer_is_for_those_who_may_see_it_now(api, fleet, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    etag = {"If-None-Match": viewer.get(address(rig)).headers["etag"]}
    stranger = api.member(api.fleet(), "admin")
    assert stranger.get(address(rig), headers=etag).json()["code"] == "not_found"
    assert api.client.get("/v1" + address(rig), headers=etag).json()["code"] == "not_signed_in"
    owner = api.owner()
    assert owner.get(address(rig), headers=etag).status_code == 304
    with api.database.writing() as session:
        limited = ApiToken(secret_hash=secret_hash("apx_limited"), name="x", person_id=owner.person_id)
        limited.fleet_id, limited.role = stranger_fleet(session), "viewer"
        session.add(limited)
        session.add(
            ApiToken(secret_hash=secret_hash("apx_ended"), name="x", person_id=owner.person_id, expires_at=utc_now())
        )
        secret = new_secret("s_")
        session.add(BrowserSession(secret_hash=secret_hash(secret), person_id=viewer.person_id, expires_at=_later()))
    for token, status in (("apx_limited", 404), ("apx_ended", 401), ("apx_nobody", 401)):
        assert Actor(owner.person_id, token, api.client).get(address(rig), headers=etag).status_code == status
    cookie = {"Cookie": f"apexcal_session={secret}", "Origin": "http://127.0.0.1:8000"}
    assert api.client.get("/v1" + address(rig), headers=cookie | etag).status_code == 304
    with api.database.writing() as session:
        session.execute(update(ApiToken).where(ApiToken.person_id == viewer.person_id).values(revoked_at=utc_now()))
        session.query(Membership).filter_by(person_id=viewer.person_id).delete()
    assert viewer.get(address(rig), headers=etag).status_code == 401
    assert api.client.get("/v1" + address(rig), headers=cookie | etag).status_code == 404


def stranger_fleet(session):
    return session.query(Fleet).order_by(Fleet.id.desc()).first().id


def _later():
    return utc_now() + timedelta(days=365)


def test_many_at_once_get_each_their_own(api, fleet, reviewer, viewer):
    rigs = []
    for number in range(12):
        rig = seed_rig(api.database, fleet)
        with api.database.writing() as session:
            session.get_one(Vehicle, rig.vehicle_id).name = f"car {number}"
        publish(api, rig, reviewer)
        rigs.append(rig)
    nobody = Actor(viewer.person_id, "apx_nobody", api.client)
    asked = [(nobody if number % 7 == 0 else viewer, rigs[number % 12]) for number in range(96)]
    with ThreadPoolExecutor(16) as pool:
        answers = list(pool.map(lambda one: one[0].get(address(one[1])), asked))
    for (who, rig), answer in zip(asked, answers, strict=True):
        assert answer.status_code == (401 if who is nobody else 200)
        if who is viewer:
            assert answer.json()["vehicle_id"] == str(rig.vehicle_id)
            assert list(answer.json()["cameras"]) == ["front"]


def test_an_answer_is_of_one_state_though_it_takes_several_statements(api, rig, reviewer, viewer, monkeypatch):
    """After the statement that gives the ETag and before those of the answer, another result is published."""
    older, newer = publish(api, rig, reviewer), []
    made = retrieval.vehicle_document

    def after_a_publication(*given):
        if not newer:
            newer.append(publish(api, rig, reviewer))
        return made(*given)

    monkeypatch.setattr(retrieval, "vehicle_document", after_a_publication)
    first, second = viewer.get(address(rig)), viewer.get(address(rig))
    ids = [one.json()["cameras"]["front"]["publication_id"] for one in (first, second)]
    assert ids == [older["id"], newer[0]["id"]]
    assert viewer.get(address(rig), headers={"If-None-Match": first.headers["etag"]}).status_code == 200
    assert viewer.get(address(rig), headers={"If-None-Match": second.headers["etag"]}).status_code == 304


def test_the_usual_question_has_the_answer_of_the_same_with_a_query(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    usual, asked = viewer.get(address(rig)), viewer.get(address(rig), params={"alias": "current"})
    assert usual.content == asked.content and usual.headers["etag"] == asked.headers["etag"]
    assert viewer.get("/vehicles/nobody/calibration").status_code == 422
    file = viewer.get(address(rig), headers={"Accept": "application/vnd.apexcal.opencv+zip"})
    assert file.headers["etag"] != usual.headers["etag"] and file.headers["content-type"] != "application/json"


def test_by_name_and_by_a_sensor(api, fleet, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(RigLidar).values(serial="L-1"))
        session.execute(update(RigCamera).values(serial="C-1"))
    whole = viewer.get(address(rig))
    for question in (
        {"vehicle": "car"}, {"vehicle": str(rig.vehicle_id)}, {"sensor": "L-1"}, {"sensor": "C-1"},
        {"vehicle": "car", "fleet": "fleet 1", "sensor": "L-1"},
    ):  # fmt: skip
        answer = viewer.get("/calibration", params=question)
        assert answer.json() == whole.json() and answer.headers["etag"] == whole.headers["etag"], question
        again = viewer.get("/calibration", params=question, headers={"If-None-Match": answer.headers["etag"]})
        assert again.status_code == 304
    for question in ({"vehicle": "bus"}, {"sensor": "L-2"}, {"vehicle": "car", "sensor": "x"}, {"vehicle": ""}):
        assert viewer.get("/calibration", params=question).json()["code"] == "no_such_vehicle"
    assert viewer.get("/calibration").json()["code"] == "vehicle_missing"
    assert api.member(api.fleet(), "admin").get("/calibration", params={"sensor": "L-1"}).status_code == 404
    other = api.fleet()
    seed_rig(api.database, other)
    owner = api.owner()
    several = owner.get("/calibration", params={"vehicle": "car"})
    assert (several.status_code, several.json()["code"]) == (409, "several_vehicles")
    assert len(several.json()["vehicles"]) == 2
    assert owner.get("/calibration", params={"vehicle": "car", "fleet": str(fleet)}).status_code == 200


def test_each_answer_has_its_hash_and_its_vehicle(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    for question in ({}, {"format": "opencv"}, {"format": "kitti"}, {"as_of": "2100-01-01T00:00:00Z"}):
        answer = viewer.get(address(rig), params=question)
        digest = b64encode(sha256(answer.content).digest()).decode()
        assert answer.headers["repr-digest"] == f"sha-256=:{digest}:"
        assert answer.headers["apexcal-vehicle"] == str(rig.vehicle_id)


def test_what_was_given_at_a_moment_is_not_answered_after_it_was_deleted(api, rig, reviewer, viewer):
    older, _ = publish(api, rig, reviewer), publish(api, rig, reviewer)
    then = {"as_of": older["published_at"]}
    answer = viewer.get(address(rig), params=then)
    etag = {"If-None-Match": answer.headers["etag"]}
    assert answer.json()["cameras"]["front"]["result_id"] == older["result_id"]
    assert viewer.get(address(rig), params=then, headers=etag).status_code == 304
    by_name = viewer.get("/calibration", params=then | {"vehicle": "car"})
    assert by_name.headers["etag"] == answer.headers["etag"]
    with api.database.writing() as session:
        found = session.get_one(Result, UUID(older["result_id"]))
        session.execute(delete(Calibration).where(Calibration.id == found.calibration_id))
    for headers in ({}, etag):
        gone = viewer.get(address(rig), params=then, headers=headers)
        assert (gone.status_code, gone.json()["code"]) == (410, "calibration_deleted")


def test_an_answer_is_another_one_once_its_calibration_has_ended(api, rig, reviewer, viewer):
    """A result may be given against the objection that its calibration has not ended."""
    given = publish(api, rig, reviewer)
    before = viewer.get(address(rig))
    with api.database.writing() as session:
        calibration = session.get_one(Calibration, session.get_one(Result, UUID(given["result_id"])).calibration_id)
        model = model_summary(UUID(given["result_id"]), heldout_mean_px=4.5)
        calibration.summary, calibration.finished_at = summary({"pinhole": model}), _later()
    for headers in ({}, {"If-None-Match": before.headers["etag"]}):
        after = viewer.get(address(rig), headers=headers)
        assert after.json()["cameras"]["front"]["quality"]["heldout_mean_px"] == 4.5


def test_a_vehicle_is_found_by_the_sensors_that_it_carries_now(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(RigLidar).values(serial="L-1"))
        session.execute(update(RigCamera).values(serial="C-1"))
    another_rig(api, rig, "roof 2", lidar_serial="L-2")
    assert viewer.get("/calibration", params={"sensor": "C-1"}).json()["code"] == "calibration_does_not_apply"
    assert viewer.get("/calibration", params={"sensor": "L-2"}).json()["code"] == "calibration_does_not_apply"
    assert viewer.get("/calibration", params={"sensor": "L-1"}).json()["code"] == "no_such_vehicle"


def test_who_has_what_there_is_is_counted_and_fills_no_log(api, rig, reviewer, viewer, served, caplog):
    publish(api, rig, reviewer)
    with caplog.at_level(logging.INFO, "service"):
        etag = viewer.get(address(rig)).headers["etag"]
        before = len(caplog.messages)
        for _ in range(100):
            assert viewer.get(address(rig), headers={"If-None-Match": etag}).status_code == 304
    assert before and len(caplog.messages) == before
    route = "/v1/vehicles/{vehicle_id}/calibration"
    counted = httpx.get(f"{served[1]}/metrics").text
    assert f'requests_total{{method="GET",route="{route}",status="304"}} 100.0' in counted
