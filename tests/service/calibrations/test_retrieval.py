"""What cars ask at every start: fresh on every process, for those who may see it now, by id, name or sensor."""

from __future__ import annotations

import asyncio
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from types import SimpleNamespace
from uuid import UUID

import psycopg
import pytest
import uvloop
from sqlalchemy import delete, update

from service.auth.secrets import new_secret, secret_hash
from service.calibrations import retrieval
from service.calibrations.given_state import Look, Prepared, Seen, read_states
from service.calibrations.kept_answers import KeptAnswer, KeptAnswers
from service.calibrations.state_reader import StateReader
from service.db.calibrations import Calibration, Result
from service.db.clock import utc_now
from service.db.fleets import Fleet, Rig, RigCamera, Vehicle
from service.db.loop_connection import LoopConnection
from service.db.people import ApiToken, BrowserSession, Membership
from service.http import etags
from tests.service.calibrations.given import another_rig, publish, withdraw
from tests.service.detections.seeding import seed_rig
from tests.support.people import Actor


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


def test_a_kept_answer_is_for_those_who_may_see_it_now(api, fleet, rig, reviewer, viewer):
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
    return utc_now().replace(year=utc_now().year + 1)


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


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_connection_that_the_server_ended_is_replaced(api, postgres, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    end_all = (
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
        " WHERE datname = current_database() AND pid <> pg_backend_pid()"
    )
    states = api.app.state.retrieval._states
    connections = set()
    with psycopg.connect(f"host={postgres.folder} user=postgres dbname=apexcal", autocommit=True) as connection:
        for _ in range(3):
            etag = {"If-None-Match": viewer.get(address(rig)).headers["etag"]}
            assert viewer.get(address(rig), headers=etag).status_code == 304
            connections.add(id(states._connection))
            assert states._connection.is_open
            connection.execute(end_all)
            assert viewer.get(address(rig), headers=etag).status_code == 304
            connection.execute("ALTER TABLE withdrawal RENAME TO elsewhere")
            assert viewer.get(address(rig), headers=etag).json()["code"] == "schema_mismatch"
            connection.execute("ALTER TABLE elsewhere RENAME TO withdrawal")
            assert viewer.get(address(rig), headers=etag).status_code == 304
    assert len(connections) > 1


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_answers_go_on_while_the_server_ends_connections(api, postgres, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    etag = {"If-None-Match": viewer.get(address(rig)).headers["etag"]}
    asked = [{"alias": name} for name in ("current", "canary", "current")] * 40
    with (
        psycopg.connect(f"host={postgres.folder} user=postgres dbname=apexcal", autocommit=True) as connection,
        ThreadPoolExecutor(8) as pool,
    ):
        answers = [pool.submit(viewer.get, address(rig), headers=etag, params=one) for one in asked]
        for _ in range(10):
            connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
                " WHERE datname = current_database() AND query LIKE '%unnest%' AND pid <> pg_backend_pid()"
            )
    statuses = [one.result().status_code for one in answers]
    assert [one for one in statuses if one not in (304, 404, 503)] == []
    assert statuses.count(304) + statuses.count(404) > len(asked) / 2
    assert viewer.get(address(rig), headers=etag).status_code == 304


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_rows_that_cannot_be_read_stop_only_their_own_request(api, rig, reviewer, viewer, monkeypatch):
    publish(api, rig, reviewer)
    etag = {"If-None-Match": viewer.get(address(rig)).headers["etag"]}
    with monkeypatch.context() as broken:
        broken.setattr(Prepared, "seen", lambda *_: UUID("no id"))
        assert viewer.get(address(rig), headers=etag).status_code == 500
    assert viewer.get(address(rig), headers=etag).status_code == 304


def test_the_usual_question_has_the_answer_of_the_same_with_a_query(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    usual, asked = viewer.get(address(rig)), viewer.get(address(rig), params={"alias": "current"})
    assert usual.content == asked.content and usual.headers["etag"] == asked.headers["etag"]
    assert viewer.get("/vehicles/nobody/calibration").status_code == 422
    file = viewer.get(address(rig), headers={"Accept": "application/vnd.apexcal.opencv+zip"})
    assert file.headers["etag"] != usual.headers["etag"] and file.headers["content-type"] != "application/json"


@pytest.mark.parametrize("make_loop", [asyncio.new_event_loop, uvloop.new_event_loop])
def test_the_loop_reads_what_a_thread_reads(api, rig, reviewer, viewer, make_loop):
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(ApiToken).values(expires_at=_later()))
    other = UUID(int=rig.vehicle_id.int ^ 1)
    places = [(viewer.token, rig.vehicle_id), ("apx_nobody", rig.vehicle_id), (viewer.token, other)]
    states = StateReader(api.database)

    async def read() -> list[Seen]:
        asked = [Look(*place, alias) for place in places for alias in ("current", "canary", "current")]
        await states.read(asked[0])  # in a thread, which connects
        found = await asyncio.gather(*map(states.read, asked))
        if states._connection is not None:
            with api.database.alone() as connection:
                pid = states._connection._driver.info.backend_pid
                connection.exec_driver_sql(f"SELECT pg_terminate_backend({pid})")
            assert await asyncio.gather(*map(states.read, asked)) == found
            assert states._connection.is_open and states._connection._driver.info.backend_pid != pid
        return found

    with asyncio.Runner(loop_factory=make_loop) as runner:
        found = runner.run(read())
    for place, of_place in zip(places, zip(*[iter(found)] * 3, strict=True), strict=True):
        for alias, seen in zip(("current", "canary", "current"), of_place, strict=True):
            with api.database.alone() as connection:
                assert [seen] == read_states(connection, alias, [Look(*place, alias)])
    assert [(one.is_known, one.may_see) for one in found[::3]] == [(True, True), (False, False), (True, False)]
    assert len({one.digest for one in found[:2]}) == 2 and found[6].fleet_id is None
    assert (states._connection is not None) == (api.database.engine.dialect.name == "postgresql")
    states.close()


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_who_waits_when_reading_ends_is_cancelled(api, rig, viewer):
    states = StateReader(api.database)

    async def end() -> list[Seen | BaseException]:
        look = Look(viewer.token, rig.vehicle_id, "current")
        await states.read(look)  # in a thread, which connects
        asked = [asyncio.ensure_future(states.read(look)) for _ in range(2)]
        await asyncio.sleep(0)  # the first one's statement is sent
        states.close()
        return await asyncio.gather(*asked, return_exceptions=True)

    assert all(isinstance(one, asyncio.CancelledError) for one in asyncio.run(end()))


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_a_connection_that_cannot_be_prepared_is_not_kept(api):
    opened = []
    database = SimpleNamespace(driver_connection=lambda: opened.append(api.database.driver_connection()) or opened[0])
    with pytest.raises(psycopg.OperationalError):
        LoopConnection(database, ["SELECT nothing"])
    assert opened[0].closed


def test_by_name_and_by_a_sensor(api, fleet, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(Rig).values(lidar_serial="L-1"))
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


def test_what_is_kept_is_bounded():
    kept = KeptAnswers(most_bytes=100)

    def put(etag: str, size: int) -> None:
        kept.put(etag, KeptAnswer(bytes(size), {}))

    for number in range(10):
        put(f"e{number}", 30)
        assert kept.get("e0") is not None  # what is asked for stays
    assert [number for number in range(10) if kept.get(f"e{number}") is not None] == [0, 8, 9]
    put("large", 200)
    assert kept.get("large") is None and kept.get("e9") is None
    put("e", 40)
    put("e", 50)
    put("f", 50)
    assert [len(kept.get(etag).content) for etag in ("e", "f")] == [50, 50]


def test_each_answer_has_its_hash_and_its_vehicle_and_the_hash_is_computed_once(
    api, rig, reviewer, viewer, monkeypatch
):
    publish(api, rig, reviewer)
    hashed = []
    monkeypatch.setattr(
        retrieval, "repr_digest", lambda content: hashed.append(content) or etags.repr_digest(content)
    )
    for question in ({}, {}, {}, {"format": "opencv"}, {"format": "kitti"}, {"as_of": "2100-01-01T00:00:00Z"}):
        answer = viewer.get(address(rig), params=question)
        digest = b64encode(sha256(answer.content).digest()).decode()
        assert answer.headers["repr-digest"] == f"sha-256=:{digest}:"
        assert answer.headers["apexcal-vehicle"] == str(rig.vehicle_id)
    assert len(hashed) == 2, "once for what is stored, once for the moment, which is not"


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
        assert (gone.status_code, gone.json()["code"]) == (404, "no_calibration_yet")


def test_an_answer_is_another_one_once_its_calibration_has_ended(api, rig, reviewer, viewer):
    """A result may be given against the objection that its calibration has not ended."""
    given = publish(api, rig, reviewer)
    before = viewer.get(address(rig))
    front = {"recommended": "pinhole", "why": "", "models": {"pinhole": {"heldout_mean_px": 4.5}}}
    with api.database.writing() as session:
        calibration = session.get_one(Calibration, session.get_one(Result, UUID(given["result_id"])).calibration_id)
        calibration.summary, calibration.finished_at = {"cameras": {"front": front}}, _later()
    for headers in ({}, {"If-None-Match": before.headers["etag"]}):
        after = viewer.get(address(rig), headers=headers)
        assert after.json()["cameras"]["front"]["quality"]["heldout_mean_px"] == 4.5


def test_a_vehicle_is_found_by_the_sensors_that_it_carries_now(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    with api.database.writing() as session:
        session.execute(update(Rig).values(lidar_serial="L-1"))
        session.execute(update(RigCamera).values(serial="C-1"))
    another_rig(api, rig, "roof 2", lidar_serial="L-2")
    assert viewer.get("/calibration", params={"sensor": "C-1"}).json()["code"] == "calibration_does_not_apply"
    assert viewer.get("/calibration", params={"sensor": "L-2"}).json()["code"] == "calibration_does_not_apply"
    assert viewer.get("/calibration", params={"sensor": "L-1"}).json()["code"] == "no_such_vehicle"
