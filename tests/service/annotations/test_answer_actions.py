"""Answers with ids that clients make: once for each id, on the version that was seen, taken back with the lease."""

import threading
from uuid import uuid4

import pytest

from service.annotations.answer_actions import MOST_ANSWERS
from service.platform.db.annotations import Answer
from service.platform.db.base import new_id
from service.platform.db.detections import VertexFrame
from service.platform.db.recordings import Blob, CameraFrame, Sensor
from tests.service.annotations.test_routes import ask, let_leases_end, reply
from tests.service.detections.seeding import seed_marking, standing
from tests.support.rows import HEIGHT, WIDTH


@pytest.fixture
def seed(api, fleet):
    return seed_marking(api.database, fleet, vertices=2)


@pytest.fixture
def ann(api, fleet):
    return api.member(fleet, "annotator")


def take_back(person, task, version, id=None):
    return person.post(f"/tasks/{task['task_id']}/undo", {"id": str(id or uuid4()), "version": version})


def rows(api, kind=None):
    with api.database.reading() as session:
        return standing(session, kind) if kind else session.query(Answer).all()


def test_an_answer_that_is_sent_twice_is_one(api, seed, ann):
    task, id = ask(ann, seed), uuid4()
    first, again = (reply(ann, task, mark=(1.5, 2.5), version=0, id=id) for _ in range(2))
    assert (first.status_code, again.status_code) == (200, 200)
    assert first.json() == again.json()
    assert first.json() == {
        "id": str(id),
        "version": 1,
        "verdict": "confirmed",
        "mark": {"u": 1.5, "v": 2.5},
        "reviewed": False,
        "progress": None,
    }
    assert len(rows(api)) == len(rows(api, "is_mark")) == len(rows(api, "is_verdict")) == 1


def test_an_id_is_one_answers_and_one_persons(api, fleet, seed, ann):
    task, id = ask(ann, seed), uuid4()
    reply(ann, task, mark=(1.5, 2.5), id=id)
    moved = reply(ann, task, mark=(9.0, 9.0), version=1, id=id)
    assert (moved.status_code, moved.json()["code"]) == (409, "answer_id_used")
    other = api.member(fleet, "annotator", "other")
    stolen = reply(other, ask(other, seed), mark=(1.5, 2.5), id=id)
    assert (stolen.status_code, stolen.json()["code"]) == (409, "answer_id_used")
    assert "1.5" not in stolen.text


def test_a_second_tab_replaces_nothing_without_a_word(api, seed, ann):
    here, there = ask(ann, seed), ask(ann, seed)
    assert here["task_id"] == there["task_id"]
    assert reply(ann, here, mark=(1.5, 2.5)).status_code == 200
    refused = reply(ann, there, mark=(400.0, 300.0))
    assert (refused.status_code, refused.json()["code"]) == (409, "answer_changed")
    assert refused.json()["own"] == {"version": 1, "mark": {"u": 1.5, "v": 2.5}, "verdict": "confirmed"}
    assert [(mark.u, mark.v) for mark in rows(api, "is_mark")] == [(1.5, 2.5)]
    assert reply(ann, there, mark=(400.0, 300.0), version=1).json()["version"] == 2
    assert [(mark.u, mark.v) for mark in rows(api, "is_mark")] == [(400.0, 300.0)]


def test_two_tabs_at_the_same_moment_are_one_after_the_other(api, seed, ann):
    task = ask(ann, seed)
    answers = []
    tabs = [
        threading.Thread(target=lambda n=n: answers.append(reply(ann, task, mark=(float(n), 1.0)))) for n in range(4)
    ]
    for tab in tabs:
        tab.start()
    for tab in tabs:
        tab.join()
    assert sorted(one.status_code for one in answers) == [200, 409, 409, 409]
    (kept,) = [one.json()["mark"] for one in answers if one.status_code == 200]
    assert [(mark.u, mark.v) for mark in rows(api, "is_mark")] == [(kept["u"], kept["v"])]


def test_undo_gives_the_vertex_back_with_its_lease_and_shows_the_mark(api, fleet, seed, ann):
    task = ask(ann, seed)
    reply(ann, task, mark=(1.5, 2.5))
    shown = ask(ann, seed)
    assert shown["vertex"]["id"] != task["vertex"]["id"]
    let_leases_end(api)
    id = uuid4()
    for _ in range(2):
        back = take_back(ann, task, 1, id)
        assert back.status_code == 200, back.text
        assert back.json()["vertex"]["id"] == task["vertex"]["id"]
        assert back.json()["own"] == {"version": 2, "mark": {"u": 1.5, "v": 2.5}, "verdict": None}
    assert rows(api, "is_mark") == rows(api, "is_verdict") == []
    # What a reload shows: the vertex that was taken back, with its mark, and to nobody else.
    assert ask(ann, seed)["task_id"] == task["task_id"]
    other = api.member(fleet, "annotator", "other")
    assert ask(other, seed)["vertex"]["id"] != task["vertex"]["id"]
    assert reply(ann, task, mark=(1.5, 2.5), version=2).json()["version"] == 3


def test_only_the_own_last_answer_is_taken_back(api, fleet, seed, ann):
    task = ask(ann, seed)
    nothing = take_back(ann, task, 0)
    assert (nothing.status_code, nothing.json()["code"]) == (409, "nothing_to_undo")
    reply(ann, task, mark=(1.0, 1.0))
    reply(ann, task, mark=(2.0, 2.0), version=1)
    stale = take_back(ann, task, 1)
    assert (stale.status_code, stale.json()["code"]) == (409, "answer_changed")
    assert take_back(api.member(fleet, "annotator", "other"), task, 2).status_code == 404
    assert [(mark.u, mark.v) for mark in rows(api, "is_mark")] == [(2.0, 2.0)]


def test_an_answer_changes_a_few_times_and_then_stays(api, seed, ann):
    task = ask(ann, seed)
    for version in range(MOST_ANSWERS):
        verdict = "rejected" if version % 2 else "confirmed"
        assert reply(ann, task, verdict, (1.0, 1.0), version).status_code == 200
    for refused in (reply(ann, task, "unsure", None, MOST_ANSWERS), take_back(ann, task, MOST_ANSWERS)):
        assert (refused.status_code, refused.json()["code"]) == (409, "answered_too_often")
        assert "reviewer" in refused.json()["hint"]
    assert [verdict.verdict for verdict in rows(api, "is_verdict")] == ["rejected"]
    assert len(rows(api)) == MOST_ANSWERS


def test_answering_and_taking_back_ends_too(api, seed, ann):
    task, version, given = ask(ann, seed), 0, 0
    while reply(ann, task, "rejected", None, version).status_code == 200:
        given, version = given + 1, version + 1
        if take_back(ann, task, version).status_code == 200:
            version += 1
    assert given == MOST_ANSWERS
    assert [verdict.verdict for verdict in rows(api, "is_verdict")] == ["rejected"], "the last answer stays"
    assert len(rows(api)) == 2 * MOST_ANSWERS - 1


def add_rear_camera(api, seed):
    """A second camera that sees every vertex."""
    with api.database.writing() as session:
        front = session.get_one(Sensor, seed.camera_id)
        session.add(Blob(key="rear", state="stored"))
        session.flush()
        copied = ("recording_id", "kind", "topic", "frame_id", "count", "first_ns", "last_ns", "facts")
        rear = Sensor(id=new_id(), name="rear", blob_key="rear", **{name: getattr(front, name) for name in copied})
        session.add(rear)
        session.flush()
        size = {"media_type": "image/jpeg", "width": WIDTH, "height": HEIGHT}
        for index, vertex_id in enumerate(seed.vertices):
            session.add(CameraFrame(sensor_id=rear.id, index=index, stamp_ns=index, offset=0, length=1, **size))
            session.flush()
            session.add(VertexFrame(vertex_id=vertex_id, sensor_id=rear.id, frame_index=index, gap_ns=0))


def test_undo_in_one_camera_leaves_the_answer_in_the_other(api, seed, ann):
    add_rear_camera(api, seed)
    front, rear = ask(ann, seed), ask(ann, seed, camera="rear")
    assert front["vertex"]["id"] == rear["vertex"]["id"]
    reply(ann, front, mark=(1.0, 1.0))
    reply(ann, rear, mark=(2.0, 2.0))
    assert take_back(ann, rear, 1).status_code == 200
    marks = ann.get(f"/detections/{seed.detection_id}/marks?camera=front").json()["items"]
    assert [(item["verdict"], item["mark"]["u"]) for item in marks] == [("confirmed", 1.0)]
    assert ann.get(f"/detections/{seed.detection_id}/marks?camera=rear").json()["items"] == []


def test_what_a_changed_verdict_leaves_without_its_mark_is_asked_again(api, fleet, ann):
    """Rejected in both cameras, then confirmed in one: the other one's answer is no longer complete."""
    seed = seed_marking(api.database, fleet, vertices=1)
    add_rear_camera(api, seed)
    front, rear = ask(ann, seed), ask(ann, seed, camera="rear")
    for task in (front, rear):
        assert reply(ann, task, "rejected").status_code == 200
    assert ask(ann, seed, camera="rear") is None
    assert reply(ann, front, "confirmed", version=1).status_code == 200
    again = ask(ann, seed, camera="rear")
    assert (again["task_id"], again["own"]["version"]) == (rear["task_id"], 1)
    assert ask(ann, seed) is None
