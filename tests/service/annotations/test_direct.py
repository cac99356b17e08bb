"""Marks and verdicts by their own addresses, with the conditions that keep two tabs from overwriting each other."""

import pytest

from service.db.annotations import AnnotationRevision, Mark
from tests.service.detections.seeding import seed_marking


@pytest.fixture
def fleet(api):
    return api.fleet()


@pytest.fixture
def seed(api, fleet):
    return seed_marking(api.database, fleet)


@pytest.fixture
def annotator(api, fleet):
    return api.member(fleet, "annotator")


def address(seed, index=0, camera="front"):
    return f"/recordings/{seed.recording_id}/cameras/{camera}/frames/{index}/mark"


def test_a_mark_is_made_once_and_corrected_by_its_version(seed, annotator):
    first = annotator.put(address(seed), json={"u": 1.5, "v": 2.5}, headers={"If-None-Match": "*"})
    assert (first.status_code, first.headers["etag"]) == (200, '"v1"')
    assert annotator.get(address(seed)).json() == {"u": 1.5, "v": 2.5, "version": 1}
    blind = annotator.put(address(seed), json={"u": 3.0, "v": 2.5})
    assert (blind.status_code, blind.json()["code"]) == (428, "if_match_required")
    twice = annotator.put(address(seed), json={"u": 3.0, "v": 2.5}, headers={"If-None-Match": "*"})
    assert (twice.status_code, twice.json()["code"]) == (412, "version_conflict")
    second = annotator.put(address(seed), json={"u": 3.0, "v": 2.5}, headers={"If-Match": '"v1"'})
    assert (second.status_code, second.headers["etag"]) == (200, '"v2"')
    stale = annotator.put(address(seed), json={"u": 4.0, "v": 2.5}, headers={"If-Match": '"v1"'})
    assert (stale.status_code, stale.json()["code"]) == (412, "version_conflict")


def test_the_same_mark_sent_again_is_no_conflict(seed, annotator):
    for _ in range(2):
        again = annotator.put(address(seed), json={"u": 1.5, "v": 2.5}, headers={"If-None-Match": "*"})
        assert (again.status_code, again.json()["version"]) == (200, 1)


def test_a_correction_of_a_mark_that_is_gone_is_a_conflict(seed, annotator):
    answer = annotator.put(address(seed), json={"u": 1.5, "v": 2.5}, headers={"If-Match": '"v1"'})
    assert (answer.status_code, answer.json()["code"]) == (412, "version_conflict")


def test_a_mark_taken_back_is_gone_but_stays_in_the_history(api, seed, annotator):
    annotator.put(address(seed), json={"u": 1.5, "v": 2.5})
    assert annotator.delete(address(seed), headers={"If-Match": '"v9"'}).status_code == 412
    assert annotator.delete(address(seed)).status_code == 204
    assert annotator.delete(address(seed)).status_code == 204
    assert annotator.get(address(seed)).json()["code"] == "not_marked"
    with api.database.reading() as session:
        assert session.query(Mark).count() == 0
        kept = [row.value for row in session.query(AnnotationRevision).order_by(AnnotationRevision.version)]
    assert kept[0]["u"] == 1.5
    assert kept[1] == {"taken_back": True}


def test_a_verdict_with_its_mark_is_an_answer_and_without_is_none(seed, annotator):
    progress = f"/detections/{seed.detection_id}/progress?camera=front"
    said = annotator.put(f"/vertices/{seed.vertices[2]}/verdict", json={"verdict": "confirmed"})
    assert said.json() == {"vertex_id": str(seed.vertices[2]), "verdict": "confirmed", "version": 1}
    assert annotator.get(progress).json()["answered"] == 0
    annotator.put(address(seed, 2), json={"u": 1.0, "v": 1.0})
    assert annotator.get(progress).json()["answered"] == 1
    annotator.delete(address(seed, 2))
    assert annotator.get(progress).json()["answered"] == 0
    changed = annotator.put(
        f"/vertices/{seed.vertices[2]}/verdict", json={"verdict": "rejected"}, headers={"If-Match": '"v1"'}
    )
    assert changed.json()["version"] == 2
    assert annotator.get(progress).json()["rejected"] == 1
    stale = annotator.put(
        f"/vertices/{seed.vertices[2]}/verdict", json={"verdict": "unsure"}, headers={"If-Match": '"v1"'}
    )
    assert stale.status_code == 412
    assert annotator.delete(f"/vertices/{seed.vertices[2]}/verdict").status_code == 204
    assert annotator.get(progress).json()["answered"] == 0


def test_an_answer_taken_back_is_handed_out_again(seed, annotator):
    tasks = f"/detections/{seed.detection_id}/tasks/next"
    task = annotator.post(tasks, {"camera": "front"}).json()
    annotator.post(f"/tasks/{task['task_id']}/answer", {"verdict": "confirmed", "mark": {"u": 1, "v": 1}})
    annotator.delete(address(seed, 0))
    given = []
    while (answer := annotator.post(tasks, {"camera": "front"})).status_code == 200:
        given.append(answer.json()["vertex"]["id"])
        annotator.post(f"/tasks/{answer.json()['task_id']}/answer", {"verdict": "unsure"})
    assert sorted(given) == sorted(str(one) for one in seed.vertices)
    assert given[-1] == task["vertex"]["id"]


def test_bad_addresses_say_what_there_is(seed, annotator):
    frame = annotator.put(address(seed, 99), json={"u": 1, "v": 1})
    assert (frame.status_code, frame.json()["code"]) == (404, "no_such_frame")
    assert "0 to 5" in frame.json()["hint"]
    camera = annotator.put(address(seed, 0, "rear"), json={"u": 1, "v": 1})
    assert (camera.status_code, camera.json()["code"]) == (404, "unknown_camera")
    outside = annotator.put(address(seed), json={"u": 640, "v": 1})
    assert (outside.status_code, outside.json()["code"]) == (422, "mark_outside_image")


def test_a_person_edits_only_their_own(api, fleet, seed, annotator):
    annotator.put(address(seed), json={"u": 1.0, "v": 1.0})
    other = api.member(fleet, "annotator", "other")
    assert other.get(address(seed)).json()["code"] == "not_marked"
    assert other.put(address(seed), json={"u": 2.0, "v": 2.0}).json()["version"] == 1
    assert annotator.get(address(seed)).json()["u"] == 1.0
    assert api.member(fleet, "viewer").put(address(seed), json={"u": 1, "v": 1}).status_code == 403
    outsider = api.member(api.fleet(), "admin")
    assert outsider.put(address(seed), json={"u": 1, "v": 1}).status_code == 404
    assert outsider.put(f"/vertices/{seed.vertices[0]}/verdict", json={"verdict": "unsure"}).status_code == 404
