"""Marks by their own addresses, with the conditions that keep two programs from overwriting each other."""

from uuid import uuid4

import pytest

from service.annotations.answer_actions import MOST_ANSWERS
from tests.service.detections.seeding import seed_marking


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


def test_a_mark_alone_is_no_answer(seed, annotator):
    annotator.put(address(seed), json={"u": 1.0, "v": 1.0})
    progress = annotator.get(f"/detections/{seed.detection_id}/progress?camera=front").json()
    assert (progress["answered"], progress["mine"]) == (0, 0)
    task = annotator.post(f"/detections/{seed.detection_id}/tasks/next", {"camera": "front"}).json()
    assert task["own"] == {"version": 1, "mark": {"u": 1.0, "v": 1.0}, "verdict": None}


def test_the_mark_of_an_answered_vertex_changes_with_its_answer_only(seed, annotator):
    task = annotator.post(f"/detections/{seed.detection_id}/tasks/next", {"camera": "front"}).json()
    said = {"id": str(uuid4()), "version": 0, "verdict": "confirmed", "mark": {"u": 1.0, "v": 1.0}}
    assert annotator.post(f"/tasks/{task['task_id']}/answer", said).status_code == 200
    moved = annotator.put(address(seed), json={"u": 9.0, "v": 9.0}, headers={"If-Match": '"v1"'})
    assert (moved.status_code, moved.json()["code"]) == (409, "answered")
    assert annotator.get(address(seed)).json() == {"u": 1.0, "v": 1.0, "version": 1}


def test_a_mark_is_moved_a_few_times_and_then_stays(seed, annotator):
    annotator.put(address(seed), json={"u": 0.0, "v": 0.0})
    for version in range(1, MOST_ANSWERS):
        etag = {"If-Match": f'"v{version}"'}
        assert annotator.put(address(seed), json={"u": version, "v": 0.0}, headers=etag).status_code == 200
    last = annotator.put(address(seed), json={"u": 99.0, "v": 0.0}, headers={"If-Match": f'"v{MOST_ANSWERS}"'})
    assert (last.status_code, last.json()["code"]) == (409, "answered_too_often")


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
