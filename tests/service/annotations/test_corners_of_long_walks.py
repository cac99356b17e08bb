"""Corners of a long walk: the first vertices are there at once, the others are made by jobs."""

import pytest
from sqlalchemy import func, select

from service.annotations import task_queries
from service.detections import actions, jobs
from service.platform.db.annotations import MarkingFrontier
from service.platform.db.detections import Apex, Vertex, VertexFrame
from service.platform.db.jobs import Job
from service.platform.jobs.queue import retry
from service.platform.jobs.reaper import reap
from tests.service.annotations.test_corners import ALL, choose, state_corners
from tests.service.annotations.test_routes import ask, reply
from tests.service.detections.seeding import seed_marking
from tests.support.work import lose_every_worker, work

AT_ONCE = 4
TIPS = 11


@pytest.fixture
def seed(api, monkeypatch):
    for module in (jobs, actions):
        monkeypatch.setattr(module, "AT_ONCE", AT_ONCE)
    found = seed_marking(api.database, api.fleet(), vertices=TIPS)
    state_corners(api.database, found.detection_id)
    return found


def counts(database):
    """(corner, vertices, apexes, frames) of all corners."""
    with database.reading() as session:
        of_vertices = dict(session.execute(select(Vertex.corner, func.count()).group_by(Vertex.corner)).all())
        of_apexes = dict(session.execute(select(Apex.corner, func.count()).group_by(Apex.corner)).all())
        framed = select(Vertex.corner, func.count()).join(VertexFrame, VertexFrame.vertex_id == Vertex.id)
        of_frames = dict(session.execute(framed.group_by(Vertex.corner)).all())
    return {name: (of_vertices[name], of_apexes[name], of_frames[name]) for name in of_vertices}


def test_a_request_makes_a_bounded_number_of_vertices_and_jobs_the_others(api, seed, context):
    engineer = api.member(seed.fleet_id, "engineer")
    answer = choose(engineer, seed, ALL)
    assert (answer.status_code, answer.json()["marked_corners"], answer.json()["state"]) == (200, ALL, "done")
    assert (answer.json()["job"]["kind"], answer.json()["job"]["state"]) == ("corners", "queued")
    assert counts(api.database) == {"top": (11, 11, 11)} | dict.fromkeys(ALL[1:], (4, 4, 4))
    with api.database.reading() as session:
        payloads = session.scalars(select(Job.payload).where(Job.kind == "corners").order_by(Job.id)).all()
    assert payloads == [{"first": 4, "stop": 8}, {"first": 8, "stop": 11}]
    work(context)
    assert counts(api.database) == dict.fromkeys(ALL, (11, 11, 11))
    after = engineer.get(f"/detections/{seed.detection_id}").json()
    assert (after["job"]["state"], after["state"]) == ("done", "done")


def test_who_was_done_with_the_tips_gets_the_corners_as_they_are_made(api, seed, context, monkeypatch):
    monkeypatch.setattr(task_queries, "_STEP", 1)
    engineer, ada = api.member(seed.fleet_id, "engineer"), api.member(seed.fleet_id, "annotator")
    while task := ask(ada, seed):
        reply(ada, task)
    choose(engineer, seed, ["top", "left"])
    at_once = []
    while task := ask(ada, seed):
        at_once.append((task["frame"]["index"], task["vertex"]["corner"]))
        reply(ada, task)
    assert at_once == [(index, "left") for index in range(4)]
    work(context)
    later = []
    while task := ask(ada, seed):
        later.append((task["frame"]["index"], task["vertex"]["corner"]))
        reply(ada, task)
    assert later == [(index, "left") for index in range(4, 11)]
    with api.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(MarkingFrontier)) == 1


def test_jobs_that_come_twice_or_late_make_nothing_twice(api, seed, context):
    engineer = api.member(seed.fleet_id, "engineer")
    choose(engineer, seed, ["top", "left"])
    choose(engineer, seed, ["top"])
    choose(engineer, seed, ["top", "left", "right"])
    work(context)
    assert counts(api.database) == dict.fromkeys(["top", "left", "right"], (11, 11, 11))
    choose(engineer, seed, ["top", "left"])
    with api.database.reading() as session:
        assert session.scalar(select(func.count()).where(Job.state == "queued")) == 0, "nothing is to be made"


def test_corners_that_are_no_longer_asked_for_are_not_made(api, seed, context):
    engineer = api.member(seed.fleet_id, "engineer")
    choose(engineer, seed, ["top", "bottom"])
    choose(engineer, seed, ["top"])
    work(context)
    assert counts(api.database) == {"top": (11, 11, 11), "bottom": (4, 4, 4)}


def test_a_failed_job_leaves_the_detection_done_and_is_started_again(api, seed, context):
    engineer = api.member(seed.fleet_id, "engineer")
    choose(engineer, seed, ["top", "left"])
    with api.database.reading() as session:
        first = session.scalars(select(Job.id).where(Job.kind == "corners").order_by(Job.id)).first()
    lose_every_worker(api.database, first)
    reap(context.database, context.store)
    work(context)
    assert counts(api.database)["left"] == (7, 7, 7)
    told = engineer.get(f"/detections/{seed.detection_id}").json()
    assert (told["state"], told["job"]["id"], told["job"]["state"]) == ("done", first, "failed")
    with api.database.writing() as session:
        assert len(retry(session, first)) == 2
    work(context)
    assert counts(api.database)["left"] == (11, 11, 11)
    assert engineer.get(f"/detections/{seed.detection_id}").json()["job"]["state"] == "done"


def test_a_corner_that_only_the_last_vertex_states_is_made(api, seed, context):
    engineer = api.member(seed.fleet_id, "engineer")
    missing = {(sweep, "left") for sweep in range(TIPS - 1)}
    state_corners(api.database, seed.detection_id, missing=missing)
    assert choose(engineer, seed, ["top", "left"]).status_code == 200
    work(context)
    assert counts(api.database)["left"] == (1, 1, 1)
