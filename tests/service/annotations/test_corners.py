"""Marks of all corners of the board: asked for, given one after the other, and made into pairs."""

import pytest

from service.platform.db.detections import Apex, Vertex, VertexFrame
from tests.service.annotations.test_routes import ask, reply
from tests.service.detections.seeding import COVARIANCE, OFFSETS, seed_corners, seed_detection, seed_marking, standing

ALL = ["top", "left", "right", "bottom"]
ONE_HIDDEN = {name: of for name, of in OFFSETS.items() if name != "left"}


@pytest.fixture
def seed(api):
    found = seed_marking(api.database, api.fleet(), vertices=3)
    with api.database.writing() as session:
        (frame,) = session.query(VertexFrame).filter_by(vertex_id=found.vertices[-1])
        tip = session.get_one(Vertex, found.vertices[-1])
        frame.x, frame.y, frame.z, frame.covariance = tip.x, tip.y + 0.1, tip.z, COVARIANCE
    seed_corners(api.database, found.detection_id, lambda sweep: ONE_HIDDEN if sweep == 1 else OFFSETS)
    return found


def choose(person, seed, corners):
    return person.patch(f"/detections/{seed.detection_id}", {"marked_corners": corners})


def test_the_tip_alone_is_asked_for_unless_somebody_asks_for_more(api, seed):
    engineer, ada = api.member(seed.fleet_id, "engineer"), api.member(seed.fleet_id, "annotator")
    path = f"/detections/{seed.detection_id}"
    before = engineer.get(f"{path}/vertices/details").json()
    assert engineer.get(path).json()["marked_corners"] == ["top"]
    assert ask(ada, seed)["vertex"]["corner"] == "top"
    assert ada.get(f"{path}/progress", params={"camera": "front"}).json()["vertices"] == 3
    assert choose(ada, seed, ["top", "left"]).status_code == 403
    assert choose(engineer, seed, ["left", "top", "left"]).json()["marked_corners"] == ["top", "left"]
    assert ada.get(f"{path}/progress", params={"camera": "front"}).json()["vertices"] == 5, "one left is not stated"
    assert engineer.get(f"{path}/vertices/details").json() == before
    assert choose(engineer, seed, []).status_code == choose(engineer, seed, ["middle"]).status_code == 422


def test_corners_that_no_vertex_states_are_refused(api):
    seed = seed_marking(api.database, api.fleet(), vertices=2)
    answer = choose(api.member(seed.fleet_id, "engineer"), seed, ["top", "bottom"])
    assert (answer.status_code, answer.json()["code"], answer.json()["corner"]) == (
        409,
        "corners_not_known",
        "bottom",
    )
    assert "measured size" in answer.json()["hint"]


def test_a_frame_stays_until_all_its_corners_are_marked(api, seed):
    assert choose(api.member(seed.fleet_id, "engineer"), seed, ALL).status_code == 200
    ada = api.member(seed.fleet_id, "annotator")
    order = []
    for number in range(11):
        task = ask(ada, seed, ahead=1)
        assert task["ahead"] or number == 10
        order.append((task["frame"]["index"], task["vertex"]["corner"]))
        assert reply(ada, task, mark=(10.0 + number, 20.0)).status_code == 200
    assert ask(ada, seed) is None
    names = ["top", "right", "left", "bottom"]
    assert order == [(f, name) for f in (0, 1, 2) for name in names if (f, name) != (1, "left")]
    with api.database.reading() as session:
        marks = [mark for mark in standing(session, "is_mark") if mark.frame_index == 0]
        assert {mark.corner: mark.u for mark in marks} == dict(zip(names, (10.0, 11.0, 12.0, 13.0), strict=True))
    own = ada.get(f"/detections/{seed.detection_id}/marks", params={"camera": "front"}).json()["items"]
    assert sorted(one["corner"] for one in own) == sorted(name for _, name in order)
    progress = ada.get(f"/detections/{seed.detection_id}/progress", params={"camera": "front"}).json()
    assert (progress["vertices"], progress["mine"], progress["complete"]) == (11, 11, 11)


def test_a_corner_that_is_no_longer_asked_for_is_not_handed_out_again(api, seed):
    engineer, ada = api.member(seed.fleet_id, "engineer"), api.member(seed.fleet_id, "annotator")
    choose(engineer, seed, ["top", "left"])
    reply(ada, ask(ada, seed))
    assert ask(ada, seed)["vertex"]["corner"] == "left"
    choose(engineer, seed, ["top"])
    next_one = ask(ada, seed)
    assert (next_one["frame"]["index"], next_one["vertex"]["corner"]) == (1, "top")


def test_corners_are_answered_and_taken_back_each_by_itself(api, seed):
    choose(api.member(seed.fleet_id, "engineer"), seed, ["top", "left"])
    ada = api.member(seed.fleet_id, "annotator")
    tip = ask(ada, seed)
    reply(ada, tip, mark=(1.0, 2.0))
    left = ask(ada, seed)
    assert (left["frame"]["index"], left["vertex"]["corner"], left["own"]["mark"]) == (0, "left", None)
    assert reply(ada, left, verdict="unsure", mark=None).status_code == 200
    given = reply(ada, ask_again := left | {"own": {"version": 1}}, mark=(3.0, 4.0))
    assert given.json()["mark"] == {"u": 3.0, "v": 4.0}
    undone = ada.post(
        f"/tasks/{ask_again['task_id']}/undo", {"id": "01900000-0000-7000-8000-000000000001", "version": 2}
    )
    assert undone.json()["own"]["mark"] == {"u": 3.0, "v": 4.0}
    path = f"/recordings/{seed.recording_id}/cameras/front/frames/0/mark"
    assert ada.get(path).json()["u"] == 1.0
    assert ada.get(path, params={"corner": "left"}).status_code == 404
    put = ada.put(path, json={"u": 5.0, "v": 6.0}, params={"corner": "right"}, headers={"If-None-Match": "*"})
    assert put.json()["u"] == 5.0
    refused = ada.put(path, json={"u": 7.0, "v": 8.0}, headers={"If-Match": ada.get(path).headers["ETag"]})
    assert refused.json()["code"] == "answered"


def test_two_people_see_nothing_of_each_others_corners(api, seed):
    engineer = api.member(seed.fleet_id, "engineer")
    choose(engineer, seed, ["top", "left"])
    ada, ben = (api.member(seed.fleet_id, "annotator") for _ in range(2))
    first, second = ask(ada, seed), ask(ben, seed)
    assert {(one["frame"]["index"], one["vertex"]["corner"]) for one in (first, second)} == {(0, "top"), (0, "left")}
    reply(ada, first, mark=(1.0, 2.0))
    assert second["own"]["mark"] is None
    assert ben.get(f"/detections/{seed.detection_id}/marks", params={"camera": "front"}).json()["items"] == []


def test_pairs_say_their_corner_and_those_of_a_sweep_are_a_group(api, seed):
    engineer, ada = api.member(seed.fleet_id, "engineer"), api.member(seed.fleet_id, "annotator")
    choose(engineer, seed, ["top", "left", "bottom"])
    marked = {}
    while task := ask(ada, seed):
        where = (task["frame"]["index"], task["vertex"]["corner"])
        marked[where] = (10.0 * len(marked), 30.0)
        reply(ada, task, mark=marked[where])
    built = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    pairs = engineer.get(f"/correspondence-sets/{built['id']}").json()["pairs"]
    assert {(one["frame_index"], one["corner"]): (one["u"], one["v"]) for one in pairs} == marked
    assert [one["group"] for one in pairs] == [one["sweep_index"] for one in pairs] == [0, 0, 0, 1, 1, 2, 2, 2]
    of = {(one["sweep_index"], one["corner"]): one for one in pairs}
    assert (of[0, "left"]["y"], of[0, "left"]["z"]) == pytest.approx((0.4, 0.1))
    assert (of[2, "bottom"]["y"], of[2, "bottom"]["gap_ns"]) == (pytest.approx(0.3), 2), "moved along the track"
    assert of[0, "left"]["sigma_elevation_rad"] == pytest.approx(2e-3)

    choose(engineer, seed, ["top"])
    again = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    assert again["id"] == built["id"], "what was marked stays"


def test_marks_of_corners_outlast_another_detection(api, seed):
    engineer, ada = api.member(seed.fleet_id, "engineer"), api.member(seed.fleet_id, "annotator")
    choose(engineer, seed, ALL)
    task = ask(ada, seed)
    reply(ada, task)
    reply(ada, right := ask(ada, seed), mark=(7.0, 8.0))
    assert right["vertex"]["corner"] == "right"
    other = seed_detection(api.database, seed.fleet_id, seed.recording_id, seed.apexes)
    seed_corners(api.database, other)
    built = engineer.post(f"/detections/{other}/correspondence-sets", {"camera": "front"}).json()
    pairs = engineer.get(f"/correspondence-sets/{built['id']}").json()["pairs"]
    assert [one["corner"] for one in pairs] == ["top", "right"], "without being asked for again"
    assert ada.get(f"/detections/{other}/progress", params={"camera": "front"}).json()["vertices"] == 3
    assert engineer.patch(f"/detections/{other}", {"marked_corners": ["right"]}).status_code == 200
    progress = ada.get(f"/detections/{other}/progress", params={"camera": "front"}).json()
    assert (progress["vertices"], progress["mine"]) == (3, 1)
    with api.database.reading() as session:
        assert session.query(Apex).filter_by(corner="right").count() == 3
