"""Many people at once: never more answers to a vertex than wanted, never the same one twice, and quickly."""

import threading
from collections import Counter

import pytest

from service.annotations import task_queries
from service.annotations.task_actions import next_tasks
from service.platform.db.annotations import Answer, MarkingTask
from service.platform.db.clock import now
from service.platform.db.detections import Detection, Vertex
from service.platform.db.people import Person
from service.platform.db.recordings import CameraFrame, Sensor
from tests.service.detections.seeding import answered, seed_marking, standing
from tests.service.platform.jobs.support import make_fleet

LEASE_S = 60.0


def make_people(database, count):
    with database.writing() as session:
        people = [Person(name=f"person {number}") for number in range(count)]
        session.add_all(people)
        session.flush()
        return [person.id for person in people]


def work_off(database, seed, person_id, failures):
    """Ask and answer until nothing is left."""
    try:
        while True:
            with database.writing() as session:
                detection = session.get_one(Detection, seed.detection_id)
                camera = session.get_one(Sensor, seed.camera_id)
                tasks = next_tasks(session, detection, camera, person_id, LEASE_S)
                vertex_id = tasks[0].vertex.id if tasks else None
            if vertex_id is None:
                return
            with database.writing() as session:
                vertex = session.get_one(Vertex, vertex_id)
                frame = session.get_one(CameraFrame, (seed.camera_id, vertex.sweep_index))
                said = answered(seed.recording_id, person_id, frame.sensor_id, frame.index, "confirmed", (1.0, 2.0))
                session.add(Answer(apex_id=vertex.apex_id, **said))
                session.query(MarkingTask).filter_by(vertex_id=vertex_id, person_id=person_id).update(
                    {"answered_at": now()}
                )
    except Exception as error:
        failures.append(error)


@pytest.mark.parametrize("wanted", [1, 2])
def test_people_at_the_same_moment_never_take_more_than_wanted(database, wanted):
    seed = seed_marking(database, make_fleet(database), vertices=15, marks_per_vertex=wanted)
    people = make_people(database, 4)
    failures = []
    threads = [threading.Thread(target=work_off, args=(database, seed, person, failures)) for person in people]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    with database.reading() as session:
        answers = Counter(row.apex_id for row in standing(session, "is_verdict"))
        assert session.query(MarkingTask).count() == len(standing(session, "is_mark")) == 15 * wanted
    assert set(answers.values()) == {wanted}
    assert len(answers) == 15


def ask(database, seed, person_id):
    with database.writing() as session:
        detection, camera = session.get_one(Detection, seed.detection_id), session.get_one(Sensor, seed.camera_id)
        tasks = next_tasks(session, detection, camera, person_id, LEASE_S)
        return tasks[0].vertex.id if tasks else None


def test_what_another_held_and_gave_back_lies_not_behind_the_frontier(database, monkeypatch):
    monkeypatch.setattr(task_queries, "_STEP", 1)
    seed = seed_marking(database, make_fleet(database), vertices=5)
    first, second = make_people(database, 2)
    assert ask(database, seed, first) == seed.vertices[0]
    assert ask(database, seed, second) == seed.vertices[1]
    with database.writing() as session:
        session.query(MarkingTask).update({"leased_until": now(-1)})
    assert ask(database, seed, second) == seed.vertices[0]
