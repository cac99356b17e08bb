"""One notion of a judged corner: after any order of marks, confirmations, undo and marks of the machine all agree."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from uuid import UUID, uuid4

import hypothesis.strategies as st
from hypothesis import HealthCheck, Phase, settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from service.analyses.clock_offsets import _camera_and_marks
from service.analyses.precision import _question
from service.annotations.consensus import agree
from service.annotations.tally_queries import opinions_of
from service.pairs.marked_pairs import _apart_px, build
from service.platform.db.annotations import MarkingTask
from service.platform.db.detections import Detection
from service.platform.db.recordings import Recording, Sensor
from service.platform.http.problems import Problem
from tests.service.annotations.test_routes import ask, let_leases_end, reply
from tests.service.crops.marking import ask as ask_crops
from tests.service.crops.marking import progress as crop_progress
from tests.service.crops.marking import reply as reply_crops
from tests.service.crops.marking import seed_blind, seed_marks, shifted_on
from tests.service.detections.seeding import seed_detection, seed_marking
from tests.support.databases import one_database

VERTICES = 14


def test_confirmed_marks_are_judged_corners_everywhere(api, fleet):
    """5 marked and 41 confirmed of 46: today's queue handed confirmed frames out again and the clock saw 5 pairs."""
    seed = seed_marking(api.database, fleet, vertices=46)
    ida, engineer = api.member(fleet, "annotator", "Ida"), api.member(fleet, "engineer")
    seed_marks(api.database, seed)
    seed_blind(api, seed, range(5))
    while (answer := ask_crops(ida, seed)).status_code == 200:
        page = answer.json()
        assert reply_crops(ida, page, shifted_on(api, page)).json()["accepted"]
    of_camera = f"/detections/{seed.detection_id}/progress?camera=front"
    counts = ida.get(of_camera).json()
    assert (counts["vertices"], counts["answered"], counts["complete"]) == (46, 46, 46)
    assert (counts["by_machine"], counts["mine"]) == (41, 41)
    assert ida.post(f"/detections/{seed.detection_id}/tasks/next", {"camera": "front"}).status_code == 204
    pairs = engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front"}).json()
    assert pairs["count"] == 46
    tally = engineer.get(f"/detections/{seed.detection_id}/tally?camera=front").json()
    assert (tally["marks"], tally["confirmed"], tally["reviewed"]) == (5, 46, 41)
    # The confirmed pixels are not told to whoever may be shown them shifted.
    own = [
        one for one in ida.get(f"/detections/{seed.detection_id}/marks?camera=front").json()["items"] if one["own"]
    ]
    assert len(own) == 41 and all(one["is_machine"] and one["mark"] is None for one in own)
    # A new detection of the same corners pairs them with the same frames: what people confirmed stays.
    again = seed_detection(api.database, fleet, seed.recording_id, seed.apexes)
    assert engineer.get(f"/detections/{again}/progress?camera=front").json()["by_machine"] == 41
    pairs = engineer.post(f"/detections/{again}/correspondence-sets", {"camera": "front"}).json()
    assert (
        pairs["count"] == 46 and "41 of 46 marks are the machine's; people looked at 41 of these." in pairs["notes"]
    )


class Counts(RuleBasedStateMachine):
    """Three people over one detection that the machine marked, all but the last two corners."""

    api = None

    @initialize(wanted=st.sampled_from([1, 2]))
    def begin(self, wanted):
        fleet = self.api.fleet()
        self.seed = seed_marking(self.api.database, fleet, vertices=VERTICES, marks_per_vertex=wanted)
        self.wanted = wanted
        seed_blind(self.api, self.seed, range(5))
        seed_marks(self.api.database, self.seed, refused=2)
        self.people = [self.api.member(fleet, "annotator", f"person {number}") for number in range(3)]
        self.engineer = self.api.member(fleet, "engineer", "builder")
        self.tasks: dict[tuple[int, str], int] = {}

    @rule(who=st.integers(0, 2), verdict=st.sampled_from(["confirmed", "confirmed", "rejected", "unsure"]))
    def answer(self, who, verdict):
        task = ask(self.people[who], self.seed)
        if task is not None:
            self._answer(who, task, verdict)

    @rule(
        who=st.integers(0, 2), rank=st.integers(0, VERTICES - 1), verdict=st.sampled_from(["confirmed", "rejected"])
    )
    def answer_this(self, who, rank, verdict):
        asked = {"camera": "front", "vertex_id": str(self.seed.vertices[rank])}
        task = self.people[who].post(f"/detections/{self.seed.detection_id}/tasks/next", asked).json()
        self._answer(who, task, verdict)

    @precondition(lambda self: self.tasks)
    @rule(data=st.data())
    def undo(self, data):
        who, task_id = data.draw(st.sampled_from(sorted(self.tasks)))
        body = {"id": str(uuid4()), "version": self.tasks[who, task_id]}
        answer = self.people[who].post(f"/tasks/{task_id}/undo", body)
        if answer.status_code == 200:
            del self.tasks[who, task_id]

    @rule(who=st.integers(0, 2), rejects=st.integers(0, 2), misses=st.integers(0, 2))
    def judge_page(self, who, rejects, misses):
        answer = ask_crops(self.people[who], self.seed)
        if answer.status_code != 200:
            return
        page = answer.json()
        shifted = shifted_on(self.api, page)
        true = [crop["vertex_id"] for crop in page["crops"] if crop["vertex_id"] not in shifted]
        reply_crops(self.people[who], page, shifted[misses:] + true[:rejects])

    @rule()
    def mark_by_the_machine_again(self):
        seed_marks(self.api.database, self.seed, refused=1)

    def _answer(self, who, task, verdict):
        mark = (50.0 + who, 60.0) if verdict == "confirmed" else None
        answer = reply(self.people[who], task, verdict, mark)
        if answer.status_code == 200:
            self.tasks[who, task["task_id"]] = answer.json()["version"]

    @invariant()
    def all_agree(self):
        detection_id, camera_id = self.seed.detection_id, self.seed.camera_id
        with self.api.database.reading() as session:
            detection, camera = session.get_one(Detection, detection_id), session.get_one(Sensor, camera_id)
            opinions = opinions_of(session, detection_id, camera_id)
            apart_px = _apart_px(session, detection, camera)
            people = {vertex: {one.person for one in said if not one.machine} for vertex, said in opinions.items()}
            agreed = {vertex for vertex, said in opinions.items() if agree(said, apart_px).pixel}
            confirmed = {
                vertex
                for vertex, said in opinions.items()
                if all(one.machine or (one.mark is None and one.verdict == "confirmed") for one in said)
            }
            recording = session.get_one(Recording, self.seed.recording_id)
            pairs = len(build(session, detection, camera, exclude_flagged=False).columns["x"]) if agreed else 0
            question = partial(_camera_and_marks, session, recording, detection, camera, "brown_conrady")
            clock = len(question()["marks"]["u"]) if agreed else 0
            with suppress(Problem):  # too few for a fit
                assert len(_question(session, detection, "front", 0).single_pairs["x"]) == pairs
        assert pairs == clock == len(agreed)
        crops = crop_progress(self.people[0], self.seed)
        for who, person in enumerate(self.people):
            progress = person.get(f"/detections/{detection_id}/progress?camera=front").json()
            mine = sum(person.person_id in said for said in people.values())
            complete = sum(len(said) >= self.wanted for said in people.values())
            assert progress == {
                "vertices": VERTICES,
                "marks_wanted": self.wanted,
                "answered": len(opinions),
                "by_machine": len(confirmed),
                "mine": mine,
                "complete": complete,
            }, who
        assert crops["unmarked"] <= VERTICES - len(opinions)
        assert {str(vertex) for vertex in opinions}.isdisjoint({crops["next_unmarked"], crops["next_blind"]})
        self._queue_is_what_is_open(people)

    def _queue_is_what_is_open(self, people: dict[UUID, set[UUID]]):
        """Everything that is open to a person who has said nothing, and nothing else, is handed out to them."""
        let_leases_end(self.api)
        asked = {"camera": "front", "ahead": 5}
        answer = self.engineer.post(f"/detections/{self.seed.detection_id}/tasks/next", asked)
        task = answer.json() if answer.status_code == 200 else {"ahead": []}
        offered = {UUID(one["vertex"]["id"]) for one in ([task] if "vertex" in task else []) + task["ahead"]}
        wanting = {vertex for vertex in self.seed.vertices if len(people.get(vertex, ())) < self.wanted}
        assert offered <= wanting and len(offered) == min(6, len(wanting))
        with self.api.database.writing() as session:
            session.query(MarkingTask).filter_by(person_id=self.engineer.person_id).delete()


@one_database
def test_after_any_order_progress_queue_pairs_clock_and_consensus_agree(api):
    machine = type("CountsHere", (Counts,), {"api": api})
    # An example takes seconds: to make it shorter would take minutes.
    phases = (Phase.explicit, Phase.reuse, Phase.generate)
    bounds = settings(deadline=None, phases=phases, suppress_health_check=list(HealthCheck))
    bounds = settings(bounds, stateful_step_count=10, max_examples=4)
    run_state_machine_as_test(machine, settings=bounds)
