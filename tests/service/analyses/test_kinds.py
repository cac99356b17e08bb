"""Every kind of analysis against the same promises, on both databases."""

import pytest

from apexcal.documents.analysis_kinds import AnalysisKind
from service.platform.db.analyses import Analysis
from service.platform.db.base import new_id
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import Rig
from service.platform.db.jobs import Job
from service.platform.jobs.claims import claim, finish
from service.platform.jobs.queue import retry
from tests.service.detections.seeding import seed_answer, seed_marking
from tests.service.publications.given import publish
from tests.support.rows import LEVEL

REGION = {"all": [{"quantity": "x", "op": ">", "value": 0}, {"quantity": "range", "op": "<", "value": 30}]}
K = [400.0, 0.0, 320.0, 0.0, 400.0, 240.0, 0.0, 0.0, 1.0]
LENS = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "K": K, "D": []}
STATED = {"lens": LENS, "transform": LEVEL}
PIXEL = {"u": 300.0, "v": 200.0, "sigma_px": 2.0}
# By kind: what the request names besides `kind`, and the role that it needs.
KINDS = {
    "preview": (("recording_id",), {"region": REGION}, "engineer"),
    "suggestion": (("recording_id",), {}, "engineer"),
    "clock_offset": (("detection_id",), {"camera": "front"}, "engineer"),
    "machine_marks": (("detection_id",), {"camera": "front"}, "engineer"),
    "precision": (("detection_id",), {"camera": "front"}, "engineer"),
    "pixel_points": (("recording_id", "result_id"), {"camera": "front", "frame": 0, "pixels": [PIXEL]}, "engineer"),
    "calibrated_copy": (("recording_id",), {"for_viewers": True}, "engineer"),
    "report": (("result_id",), {}, "reviewer"),
    "remedies": (("result_id",), {}, "engineer"),
    "pair_validation": (("set_id",), {"calibration": STATED}, "engineer"),
    "lane_validation": (("recording_id", "result_id"), {"camera": "front"}, "engineer"),
    "edge_validation": (("recording_id",), {"camera": "front"}, "engineer"),
}
BELOW = {"engineer": "reviewer", "reviewer": "annotator"}


@pytest.fixture
def ids(api, fleet, engineer, reviewer):
    """A vehicle with a marked recording, and a published result of pairs from it."""
    seed = seed_marking(api.database, fleet, vertices=20)
    for number in range(20):
        seed_answer(api.database, seed, engineer.person_id, number, "confirmed", (10.0 + number, 20.0))
    with api.database.reading() as session:
        rig = session.get_one(Rig, seed.rig_id)
    made = publish(api, rig, reviewer)
    with api.database.writing() as session:
        pairs = session.query(CorrespondenceSet).one()
        pairs.recording_id = seed.recording_id
        named = {"recording_id": seed.recording_id, "detection_id": seed.detection_id, "set_id": pairs.id}
    return {name: str(id) for name, id in named.items()} | {"result_id": made["result_id"]}


def body_of(kind, ids):
    named, more, _ = KINDS[kind]
    return {"kind": kind, **{name: ids[name] for name in named}, **more}


def count(api):
    with api.database.reading() as session:
        return session.query(Analysis).count(), session.query(Job).count()


def test_every_kind_is_here():
    assert set(KINDS) == set(AnalysisKind.__args__)


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_asked_for_once_and_its_job_ends_it_once(api, engineer, viewer, ids, kind):
    headers = {"Idempotency-Key": "one"}
    asked, again = (engineer.post("/analyses", body_of(kind, ids), headers=headers) for _ in range(2))
    assert (asked.status_code, again.json()) == (202, asked.json()), asked.text
    made = asked.json()
    assert (made["kind"], made["state"], made["result"], made["job"]["kind"]) == (kind, "queued", None, kind)
    assert count(api) == (1, 1)
    for subject in ("vehicle_id", "recording_id", "result_id"):
        listed = viewer.get("/analyses", params={"kind": [kind], subject: made[subject] or str(new_id())}).json()
        assert [one["id"] for one in listed["items"]] == ([made["id"]] if made[subject] else [])
    others = [one for one in KINDS if one != kind]
    assert viewer.get("/analyses", params={"kind": others}).json()["items"] == []
    held = claim(api.database, made["job"]["id"], "worker")
    finish(api.database, held, state="failed", problem={"code": "no_luck", "detail": "It failed.", "hint": "Try."})
    failed = viewer.get(f"/analyses/{made['id']}").json()
    assert (failed["state"], failed["problem"]["code"]) == ("failed", "no_luck")
    with api.database.writing() as session:
        (fresh,) = retry(session, made["job"]["id"])
    queued = viewer.get(f"/analyses/{made['id']}").json()
    assert (queued["state"], queued["problem"], queued["job"]["id"]) == ("queued", None, fresh.id)


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_for_its_fleet_and_role(api, fleet, engineer, ids, kind):
    body, role = body_of(kind, ids), KINDS[kind][2]
    below, outsider = api.member(fleet, BELOW[role]), api.member(api.fleet(), "admin")
    refused, unknown = below.post("/analyses", body), outsider.post("/analyses", body)
    assert (refused.status_code, refused.json()["code"]) == (403, "role_too_low")
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")
    for name in KINDS[kind][0]:
        assert engineer.post("/analyses", body | {name: str(new_id())}).status_code == 404
    for wrong in (body | {"more": 1}, {"kind": kind}):
        assert engineer.post("/analyses", wrong).json()["code"] == "invalid_request"
    assert count(api) == (0, 0)
    address = f"/analyses/{api.member(fleet, role).post('/analyses', body).json()['id']}"
    for path in (address, f"{address}/file"):
        assert outsider.get(path).status_code == 404
    assert engineer.get(f"{address}/file").json()["code"] == "no_file"
    assert (outsider.delete(address).status_code, below.delete(address).status_code) == (404, 403)
    assert outsider.get("/analyses").json()["items"] == []
    assert count(api) == (1, 1)


@pytest.mark.parametrize("kind", KINDS)
def test_it_goes_with_its_job_and_with_what_it_is_of(api, engineer, ids, kind):
    first, second = (engineer.post("/analyses", body_of(kind, ids)).json()["id"] for _ in range(2))
    assert engineer.delete(f"/analyses/{first}").status_code == 204
    assert engineer.get(f"/analyses/{first}").status_code == 404
    gone = engineer.delete(f"/recordings/{ids['recording_id']}", params={"with_published": "true"})
    assert gone.status_code == 204, gone.text
    assert engineer.get(f"/analyses/{second}").status_code == 404
    with api.database.reading() as session:
        assert {job.state for job in session.query(Job)} == {"cancelled"}
