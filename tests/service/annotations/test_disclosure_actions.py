"""Nobody is told another's mark before they may; who was told anything answers as a reviewer from then on."""

from uuid import UUID

import pytest
from sqlalchemy import update

from service.platform.db.analyses import Analysis
from service.platform.db.annotations import Disclosure
from service.platform.db.base import new_id
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.recordings import Recording
from tests.service.annotations.test_answer_actions import add_rear_camera, take_back
from tests.service.annotations.test_routes import ask, reply
from tests.service.detections.seeding import seed_marking
from tests.support.people import Actor
from tests.support.results import fit_result, model_summary, of_block, rig_summary, summary

SECRET = (123.4375, 77.8125)


@pytest.fixture
def seed(api, fleet):
    return seed_marking(api.database, fleet, vertices=2, marks_per_vertex=2)


@pytest.fixture
def one(api, fleet):
    return api.member(fleet, "annotator", "Mallory Secretname")


@pytest.fixture
def two(api, fleet):
    return api.member(fleet, "annotator", "two")


def listen(monkeypatch, person):
    """Everything that the service answers to a person from now on, head and body."""
    heard = []
    plain = Actor.request

    def request(self, method, path, **options):
        answer = plain(self, method, path, **options)
        if self is person:
            heard.append((f"{method} {path}", f"{answer.headers} {answer.text}"))
        return answer

    monkeypatch.setattr(Actor, "request", request)
    return heard


def everything_readable(person, seed, **ids):
    """GET every address about this detection and what came of it."""
    detection, recording = f"/detections/{seed.detection_id}", f"/recordings/{seed.recording_id}"
    addresses = [
        *(f"{detection}{end}" for end in ("", "/vertices", "/progress?camera=front", "/tally?camera=front")),
        f"{detection}/expected-corners?camera=front",
        *(f"{detection}/marks?camera=front", f"{detection}/marks?camera=front&limit=1"),
        *(f"{recording}{end}" for end in ("", "/detections", "/cameras/front/frames")),
        f"/analyses?recording_id={seed.recording_id}",
        *(f"{recording}/cameras/front/frames/{index}/mark" for index in range(2)),
        *(f"/vehicles/{seed.vehicle_id}/calibrations", f"/rigs/{seed.rig_id}/correspondence-sets"),
        *(f"/correspondence-sets/{ids['set']}", f"/calibrations/{ids['calibration']}", f"/results/{ids['result']}"),
        *(f"/calibrations/{ids['calibration']}/slots", "/jobs", "/recordings", "/me"),
        f"/fleets/{seed.fleet_id}/members",
    ]
    return {address: person.get(address) for address in addresses}


def calibrated(api, fleet, seed):
    """What an engineer made of the marks so far: a set, a calibration and a result that names an outlier."""
    built = api.member(fleet, "engineer", "early engineer").post(
        f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}
    )
    assert built.status_code == 201, built.text
    outlier = {"index": 0, "residual_px": 941.6875, "score": 9.0, "reason": "941.6875 px right.", "excluded": False}
    document = fit_result(outliers=[outlier], residuals_px=[941.6875], heldout=of_block([941.6875], [0]))
    apart = {"indices": [0, 0], "stamp_ns": 0, "distance_px": 941.6875, "sigmas": 9.0}
    own = {"fleet_id": fleet, "vehicle_id": seed.vehicle_id, "rig_id": seed.rig_id}
    with api.database.writing() as session:
        pairs = session.query(CorrespondenceSet).one()
        calibration = Calibration(
            **own, request={}, content_hash="0", state="done", remaining=0, publish="none", notes=[]
        )
        calibration.summary = summary({"pinhole": model_summary(new_id(), document)}, rig=rig_summary([apart]))
        session.add(calibration)
        session.flush()
        common = {"fleet_id": fleet, "calibration_id": calibration.id, "camera": "front", "fold": -1}
        run = CalibrationRun(**common, set_id=pairs.id, model="pinhole", state="done", farm="runs", slots=1, bundle=1)
        run.fit_request = {"seed": 1}
        session.add(run)
        session.flush()
        result = Result(**common, run_id=run.id, model="pinhole", document=document)
        session.add(result)
        session.flush()
        return {"set": pairs.id, "calibration": calibration.id, "result": result.id}


@pytest.mark.parametrize("role", ["annotator", "viewer"])
def test_no_answer_of_the_service_tells_a_blind_person_anything_of_others(api, fleet, seed, one, role, monkeypatch):
    asked = ask(one, seed)
    reply(one, asked, mark=SECRET)
    ids = calibrated(api, fleet, seed)
    blind = api.member(fleet, role, "blind one")
    heard = listen(monkeypatch, blind)
    told = everything_readable(blind, seed, **ids)
    if role == "annotator":
        task = ask(blind, seed)
        assert task["vertex"]["id"] == asked["vertex"]["id"]
        for version, verdict in enumerate(("unsure", "rejected")):
            assert reply(blind, task, verdict, None, version).status_code == 200
            assert reply(blind, task, "unsure", None, 0).status_code == 409
        assert take_back(blind, task, 2).status_code == 200
        everything_readable(blind, seed, **ids)
    # Numbers that no time of day has.
    secrets = ("123.43", "77.81", "Mallory", str(one.person_id), one.person_id.hex, "941.68")
    assert [(where, secret) for where, text in heard for secret in secrets if secret in text] == []
    assert [(where, text) for where, text in heard if '"confirmed"' in text or "judged by anybody" in text] == []
    refused = {address for address, answer in told.items() if answer.status_code == 403}
    assert refused == {
        f"/detections/{seed.detection_id}/tally?camera=front",
        f"/correspondence-sets/{ids['set']}",
        f"/fleets/{fleet}/members",
    }
    with api.database.reading() as session:
        assert session.query(Disclosure).filter_by(person_id=blind.person_id).count() == 0


def marks(person, seed):
    answer = person.get(f"/detections/{seed.detection_id}/marks?camera=front")
    assert answer.status_code == 200
    return {(item["person"], item["vertex_id"]): item for item in answer.json()["items"]}


def test_a_complete_vertex_is_shown_to_who_decided_it_and_changes_are_then_reviewed(api, fleet, seed, one, two):
    first = ask(one, seed)
    reply(one, first, mark=SECRET)
    assert len(marks(one, seed)) == 1
    task = ask(two, seed)
    reply(two, task, "unsure", None)
    assert {name for name, _ in marks(two, seed)} == {"two"}, "complete, and not decided"
    reply(two, task, mark=(5.0, 5.0), version=1)
    seen = marks(two, seed)
    assert seen["Mallory Secretname", task["vertex"]["id"]]["mark"]["u"] == SECRET[0]
    assert not any(item["reviewed"] for item in seen.values())
    assert reply(two, task, mark=SECRET, version=2).json()["reviewed"] is True
    assert take_back(two, task, 3).status_code == 200
    assert reply(two, task, mark=SECRET, version=4).json()["reviewed"] is True, "undo makes nobody blind again"
    own = marks(two, seed)["two", task["vertex"]["id"]]
    assert own["reviewed"] is True
    assert own["told_at"] is not None
    assert marks(one, seed)["Mallory Secretname", first["vertex"]["id"]]["reviewed"] is False


def test_nothing_is_shown_of_a_vertex_that_waits_for_more_answers(api, fleet, seed, one, two):
    with api.database.writing() as session:
        session.execute(update(Recording).values(marks_per_vertex=3))
    reply(one, ask(one, seed), mark=SECRET)
    task = ask(two, seed)
    reply(two, task, "rejected", None)
    assert {name for name, _ in marks(two, seed)} == {"two"}


def validated(api, seed, set_id):
    """A validation on pairs made of marks."""
    of = {"fleet_id": seed.fleet_id, "vehicle_id": seed.vehicle_id, "set_id": UUID(str(set_id)), "state": "done"}
    with api.database.writing() as session:
        row = Analysis(**of, kind="pair_validation", asked={"camera": "front"}, result={}, single_pairs={"u": [1.0]})
        session.add(row)
        session.flush()
        return row.id


@pytest.mark.parametrize("told_in", ["marks", "tally", "pairs", "build", "result", "analysis", "calibration"])
def test_who_looked_first_answers_as_a_reviewer_there_and_nowhere_else(api, fleet, seed, one, told_in):
    reply(one, ask(one, seed), mark=SECRET)
    ids = calibrated(api, fleet, seed)
    engineer = api.member(fleet, "engineer", "looking engineer")
    detection = f"/detections/{seed.detection_id}"
    addresses = {
        "marks": f"{detection}/marks?camera=front",
        "tally": f"{detection}/tally?camera=front",
        "pairs": f"/correspondence-sets/{ids['set']}",
        "result": f"/results/{ids['result']}",
        "analysis": f"/analyses/{validated(api, seed, ids['set'])}",
        "calibration": f"/calibrations/{ids['calibration']}",
    }
    for _ in range(2):
        if told_in == "build":
            looked = engineer.post(f"{detection}/correspondence-sets", {"camera": "front"})
        else:
            looked = engineer.get(addresses[told_in])
        assert looked.status_code in (200, 201), looked.text
    with api.database.reading() as session:
        (kept,) = session.query(Disclosure).filter_by(person_id=engineer.person_id)
        assert (kept.sensor_id, kept.frame_index, kept.sweep_index, kept.corner) == (seed.camera_id, 0, 0, "top")
        assert kept.told_in == {"build": "pairs", "analysis": "result"}.get(told_in, told_in)
    task = ask(engineer, seed)
    assert task["vertex"]["id"] == str(seed.vertices[0])
    assert reply(engineer, task, mark=(5.0, 5.0)).json()["reviewed"] is True
    unseen = ask(engineer, seed)
    assert reply(engineer, unseen, mark=(5.0, 5.0)).json()["reviewed"] is False


def test_an_engineer_who_did_not_look_is_blind(api, fleet, seed, one):
    reply(one, ask(one, seed), mark=SECRET)
    ids = calibrated(api, fleet, seed)
    engineer = api.member(fleet, "engineer", "blind engineer")
    engineer.get(f"/detections/{seed.detection_id}/progress?camera=front")
    engineer.get(f"/rigs/{seed.rig_id}/correspondence-sets")
    engineer.get(f"/vehicles/{seed.vehicle_id}/calibrations")
    assert ids
    assert reply(engineer, ask(engineer, seed), mark=(5.0, 5.0)).json()["reviewed"] is False


def test_who_looked_in_one_camera_knows_the_verdicts_of_all(api, fleet, seed, one):
    add_rear_camera(api, seed)
    reply(one, ask(one, seed), mark=SECRET)
    reviewer = api.member(fleet, "reviewer")
    marks(reviewer, seed)
    assert reply(reviewer, ask(reviewer, seed, camera="rear"), mark=(5.0, 5.0)).json()["reviewed"] is True


def test_a_mark_without_an_answer_is_reviewed_too(api, fleet, seed, one):
    reply(one, ask(one, seed), mark=SECRET)
    reviewer = api.member(fleet, "reviewer")
    marks(reviewer, seed)
    reviewer.put(f"/recordings/{seed.recording_id}/cameras/front/frames/0/mark", json={"u": 1.0, "v": 1.0})
    task = ask(reviewer, seed)
    assert task["own"]["mark"] == {"u": 1.0, "v": 1.0}
    assert reply(reviewer, task, mark=(1.0, 1.0)).json()["reviewed"] is True
    assert marks(reviewer, seed)["reviewer", task["vertex"]["id"]]["reviewed"] is True


def test_a_reviewed_answer_is_no_independent_mark_of_a_set(api, fleet, seed, one):
    reply(one, ask(one, seed), mark=SECRET)
    reviewer = api.member(fleet, "reviewer")
    marks(reviewer, seed)
    reply(reviewer, ask(reviewer, seed), mark=(SECRET[0] + 2.0, SECRET[1]))
    engineer = api.member(fleet, "engineer")
    built = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    (pair,) = engineer.get(f"/correspondence-sets/{built['id']}").json()["pairs"]
    assert (pair["u"], pair["v"]) == (SECRET[0] + 1.0, SECRET[1]), "it counts"
    assert (pair["marks"], pair["spread_px"], pair["reviewed"]) == (1, 0.0, 1), "and is no second opinion"
    assert any("seen others' answers" in note for note in built["notes"])
    assert any("fewer than the 2 independent marks" in note for note in built["notes"])
