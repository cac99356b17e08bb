"""A person's own marks with their vertices, which the marking page expects the next mark by."""

import pytest
from sqlalchemy import select

from service.platform.db.detections import VertexFrame
from tests.service.annotations.test_routes import ask, reply
from tests.service.detections.seeding import seed_marking


@pytest.fixture
def fleet(api):
    return api.fleet()


@pytest.fixture
def seed(api, fleet):
    return seed_marking(api.database, fleet, vertices=4, marks_per_vertex=3)


def own_pairs(person, seed):
    answer = person.get(f"/detections/{seed.detection_id}/own-pairs?camera=front")
    assert answer.status_code == 200, answer.text
    return answer.json()["items"]


def test_they_are_the_own_confirmed_ones_in_the_order_of_the_marks(api, fleet, seed):
    one, two = (api.member(fleet, "annotator", name) for name in ("one", "two"))
    marked = []
    for number, verdict in enumerate(("confirmed", "rejected", "confirmed")):
        task = ask(one, seed)
        reply(one, task, verdict, (10.0 + number, 20.0) if verdict == "confirmed" else None)
        if verdict == "confirmed":
            marked.append((task["vertex"], 10.0 + number))
    reply(two, ask(two, seed), mark=(33.0, 44.0))
    found = own_pairs(one, seed)
    assert [(item["vertex_id"], item["u"]) for item in found] == [(vertex["id"], u) for vertex, u in marked]
    for item, (vertex, _) in zip(found, marked, strict=True):
        assert [item[name] for name in "xyz"] == [vertex[name] for name in "xyz"]
    assert [item["u"] for item in own_pairs(two, seed)] == [33.0]
    # They tell nothing of others: what is answered afterwards is independent.
    assert reply(two, ask(two, seed), mark=(5.0, 5.0)).json()["reviewed"] is False


def test_a_vertex_that_was_moved_along_its_track_is_where_it_was_at_the_frame(api, fleet, seed):
    one = api.member(fleet, "annotator", "one")
    task = ask(one, seed)
    assert task["moved"] is None
    covariance = [[1e-6, 0.0, 0.0], [0.0, 1e-6, 0.0], [0.0, 0.0, 1e-4]]
    with api.database.writing() as session:
        for frame in session.scalars(select(VertexFrame)):
            frame.x, frame.y, frame.z, frame.covariance = 7.0, 1.0, 0.5, covariance
    moved = ask(one, seed)["moved"]
    assert (moved["x"], moved["y"], moved["z"]) == (7.0, 1.0, 0.5)
    reply(one, task, mark=(10.0, 20.0))
    assert [[item[name] for name in "xyz"] for item in own_pairs(one, seed)] == [[7.0, 1.0, 0.5]]


def test_who_marked_nothing_has_none(api, fleet, seed):
    one = api.member(fleet, "annotator", "one")
    reply(one, ask(one, seed), mark=(10.0, 20.0))
    assert own_pairs(api.member(fleet, "viewer"), seed) == []
