"""Over reruns with other offsets, undo and corrections: no mark of what was told is independent, no click is two."""

from __future__ import annotations

from collections import defaultdict
from uuid import UUID, uuid4

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from sqlalchemy import delete

from service.annotations.consensus import agree
from service.annotations.tally_queries import opinions_of
from service.platform.db.annotations import MarkingProgress
from service.platform.db.detections import Detection, Vertex, VertexFrame
from tests.service.annotations.test_routes import ask, reply
from tests.service.detections.seeding import seed_detection, seed_marking, standing
from tests.support.databases import one_database

VERTICES = 3
PLACES = st.sampled_from([(1.0, 1.0), (2.0, 2.0), (300.0, 200.0)])


def shifted(api, seed, offset):
    """Another detection of the same apexes, whose vertices are paired with frames so many later."""
    detection_id = seed_detection(api.database, seed.fleet_id, seed.recording_id, seed.apexes)
    with api.database.writing() as session:
        for frame in session.query(VertexFrame).join(Vertex).filter(Vertex.detection_id == detection_id):
            frame.frame_index = (frame.frame_index + offset) % (VERTICES + 1)
    return detection_id


@pytest.mark.parametrize("is_gone", [False, True])
def test_what_was_told_in_one_detection_is_reviewed_in_another_with_another_offset(api, fleet, is_gone):
    seed = seed_marking(api.database, fleet, vertices=2, marks_per_vertex=2)
    one, reviewer = api.member(fleet, "annotator", "one"), api.member(fleet, "reviewer", "Rea")
    assert reply(one, ask(one, seed), mark=(5.0, 5.0)).status_code == 200
    assert reviewer.get(f"/detections/{seed.detection_id}/marks?camera=front").json()["items"]
    # Frame 0, whose mark was told, is another vertex's in the rerun.
    rerun = seed_detection(api.database, fleet, seed.recording_id, seed.apexes[1:])
    with api.database.writing() as session:
        frame = session.query(VertexFrame).join(Vertex).filter(Vertex.detection_id == rerun).one()
        frame.frame_index = 0
        if is_gone:
            session.execute(delete(Detection).where(Detection.id == seed.detection_id))
    task = reviewer.post(f"/detections/{rerun}/tasks/next", {"camera": "front"}).json()
    assert task["frame"]["index"] == 0
    assert reply(reviewer, task, mark=(5.0, 5.0)).json()["reviewed"] is True


def test_a_mark_that_was_taken_back_is_told_by_the_pairs_that_keep_it(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=1, marks_per_vertex=2)
    one, engineer = api.member(fleet, "annotator", "one"), api.member(fleet, "engineer", "builder")
    task = ask(one, seed)
    reply(one, task, mark=(5.0, 5.0))
    built = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    one.post(f"/tasks/{task['task_id']}/undo", {"id": str(uuid4()), "version": 1})
    reviewer = api.member(fleet, "reviewer", "Rea")
    assert reviewer.get(f"/correspondence-sets/{built['id']}").status_code == 200
    assert reply(reviewer, ask(reviewer, seed), mark=(5.0, 5.0)).json()["reviewed"] is True


class Blindness(RuleBasedStateMachine):
    """Two reviewers and an annotator over three detections that pair the same sweeps with other frames.

    The model knows by frame alone who was shown a mark of somebody else.
    """

    api = None

    @initialize()
    def begin(self):
        fleet = self.api.fleet()
        self.seed = seed_marking(self.api.database, fleet, vertices=VERTICES, marks_per_vertex=2)
        self.detections = [self.seed.detection_id, *(shifted(self.api, self.seed, offset) for offset in (1, 2))]
        roles = ("annotator", "reviewer", "reviewer")
        self.people = [self.api.member(fleet, role, f"{role} {number}") for number, role in enumerate(roles)]
        self.tasks: dict[tuple[int, UUID], tuple[str, int]] = {}
        # What a person was shown of others' marks, and the marks that they set after that, by frame.
        self.told: dict[int, set[int]] = defaultdict(set)
        self.after: dict[int, set[int]] = defaultdict(set)

    @rule(who=st.integers(0, 2), which=st.integers(0, 2), place=PLACES, rejects=st.booleans())
    def answer(self, who, which, place, rejects):
        person = self.people[who]
        task = person.post(f"/detections/{self.detections[which]}/tasks/next", {"camera": "front"})
        if task.status_code == 204:
            return
        self._answer(who, task.json(), place, rejects=rejects)

    @precondition(lambda self: self.tasks)
    @rule(data=st.data(), place=PLACES, undo=st.booleans())
    def correct(self, data, place, undo):
        who, task_id = data.draw(st.sampled_from(sorted(self.tasks)))
        task, version = self.tasks[who, task_id]
        if undo:
            answer = self.people[who].post(f"/tasks/{task_id}/undo", {"id": str(uuid4()), "version": version})
            if answer.status_code == 200:
                self.tasks[who, task_id] = (task, answer.json()["own"]["version"])
        else:
            self._answer(who, task | {"own": {"version": version}}, place)

    @rule(who=st.integers(0, 2), frame=st.integers(0, VERTICES), place=PLACES)
    def mark_alone(self, who, frame, place):
        path = f"/recordings/{self.seed.recording_id}/cameras/front/frames/{frame}/mark"
        before = self.people[who].get(path)
        headers = {"If-Match": before.headers["ETag"]} if before.status_code == 200 else {"If-None-Match": "*"}
        body = {"u": place[0], "v": place[1]}
        answer = self.people[who].put(path, json=body, headers=headers)
        if answer.status_code == 200:
            self._set(who, frame, before.status_code == 200 and before.json() == answer.json())

    @rule(who=st.integers(0, 2), which=st.integers(0, 2))
    def look(self, who, which):
        answer = self.people[who].get(f"/detections/{self.detections[which]}/marks?camera=front")
        self.told[who] |= {one["frame_index"] for one in answer.json()["items"] if not one["own"]}

    @invariant()
    def no_mark_after_a_disclosure_is_independent(self):
        with self.api.database.reading() as session:
            marks = {(mark.person_id, mark.frame_index): mark for mark in standing(session, "is_mark")}
            for who, frames in self.after.items():
                for frame in frames:
                    mark = marks.get((self.people[who].person_id, frame))
                    assert mark is None or mark.reviewed, (who, frame)
            for detection_id in self.detections:
                opinions = opinions_of(session, detection_id, self.seed.camera_id)
                of_frame = {
                    frame.vertex_id: frame.frame_index
                    for frame in session.query(VertexFrame).join(Vertex).filter(Vertex.detection_id == detection_id)
                }
                for vertex_id, said in opinions.items():
                    frame = of_frame[vertex_id]
                    assert len({one.person for one in said}) == len(said)
                    blind = {
                        person.person_id
                        for who, person in enumerate(self.people)
                        if (person.person_id, frame) in marks and frame not in self.after[who]
                    }
                    assert agree(said).marks <= len(blind), (said, blind)

    def teardown(self):
        """The counters are what is counted."""
        if not hasattr(self, "detections"):
            return
        for which, detection_id in enumerate(self.detections):
            path = f"/detections/{detection_id}/progress?camera=front"
            before = [person.get(path).json() for person in self.people]
            with self.api.database.writing() as session:
                # Without its rows everything is counted anew.
                session.execute(delete(MarkingProgress).where(MarkingProgress.detection_id == detection_id))
            assert [person.get(path).json() for person in self.people] == before, which

    def _answer(self, who, task, place, *, rejects=False):
        answer = reply(self.people[who], task, "rejected" if rejects else "confirmed", None if rejects else place)
        if answer.status_code != 200:
            assert answer.json()["code"] in ("answered_too_often", "answer_changed"), answer.text
            return
        self.tasks[who, task["task_id"]] = (task, answer.json()["version"])
        if not rejects:
            self._set(who, task["frame"]["index"], task["own"].get("mark") == {"u": place[0], "v": place[1]})

    def _set(self, who, frame, is_same):
        if frame in self.told[who] and not is_same:
            self.after[who].add(frame)


@one_database
def test_nothing_that_was_told_is_independent_and_no_click_counts_twice(api):
    machine = type("BlindnessHere", (Blindness,), {"api": api})
    bounds = settings(deadline=None, stateful_step_count=20, max_examples=12, suppress_health_check=list(HealthCheck))
    run_state_machine_as_test(machine, settings=bounds)
