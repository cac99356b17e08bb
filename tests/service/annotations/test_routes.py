"""Tasks one after the other: leases, what is handed out to whom, and what people see of each other."""

from uuid import uuid4

from service.platform.db.annotations import Answer, MarkingTask
from service.platform.db.clock import now
from service.platform.db.detections import Detection, VertexFrame
from service.platform.db.recordings import Recording
from tests.service.detections.seeding import seed_answer, seed_detection, seed_marking, standing


def ask(person, seed, skip=None, camera="front", ahead=0):
    body = {"camera": camera, "ahead": ahead} | ({"skip": skip} if skip else {})
    answer = person.post(f"/detections/{seed.detection_id}/tasks/next", body)
    assert answer.status_code in (200, 204), answer.text
    return answer.json() if answer.status_code == 200 else None


def reply(person, task, verdict="confirmed", mark=(10.0, 20.0), version=None, id=None):
    version = task["own"]["version"] if version is None else version
    body = {"id": str(id or uuid4()), "version": version, "verdict": verdict}
    return person.post(f"/tasks/{task['task_id']}/answer", body | {"mark": mark and {"u": mark[0], "v": mark[1]}})


def let_leases_end(api):
    with api.database.writing() as session:
        session.query(MarkingTask).update({"leased_until": now(-1)})


def named(task):
    return [one["vertex"]["id"] for one in (task, *task["ahead"])]


def test_what_comes_next_is_leased_ahead_and_comes_in_that_order(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=6)
    one, two = api.member(fleet, "annotator"), api.member(fleet, "annotator")
    vertices = [str(id) for id in seed.vertices]
    task = ask(one, seed, ahead=2)
    assert named(task) == vertices[:3]
    assert named(ask(two, seed, ahead=1)) == vertices[3:5]
    # Asked again, and without any ahead, it is the same order.
    assert named(ask(one, seed, ahead=2)) == vertices[:3]
    assert named(ask(one, seed)) == vertices[:1]
    # An answer may come before or after the question what is next.
    assert reply(one, task["ahead"][0]).status_code == 200
    assert named(ask(one, seed, ahead=2)) == [vertices[0], vertices[2], vertices[5]]
    assert reply(one, task).status_code == 200
    again = ask(one, seed, ahead=2)
    assert named(again) == [vertices[2], vertices[5]]
    # Nothing else is open: two are held by somebody else.
    assert named(ask(one, seed, skip=again["task_id"], ahead=2)) == [vertices[5]]


def test_many_ahead_leave_others_enough(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=72)
    one, two, three = (api.member(fleet, "annotator") for _ in range(3))
    # Half of all; of 35 that are left for two half of the share; then at least five.
    held = [named(ask(person, seed, ahead=50)) for person in (one, two, three)]
    assert [len(vertices) for vertices in held] == [37, 1 + 35 // 4, 1 + 5]
    assert len({vertex for vertices in held for vertex in vertices}) == sum(map(len, held))
    # Who asks again keeps what they hold, in its order.
    assert named(ask(one, seed, ahead=50)) == held[0]


def test_what_was_taken_back_comes_before_what_is_leased_ahead(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=5)
    one = api.member(fleet, "annotator")
    task = ask(one, seed, ahead=2)
    reply(one, task)
    ask(one, seed, ahead=2)
    undone = one.post(f"/tasks/{task['task_id']}/undo", {"id": str(uuid4()), "version": 1})
    assert (undone.status_code, undone.json()["ahead"]) == (200, [])
    assert named(ask(one, seed, ahead=2)) == [str(id) for id in seed.vertices[:3]]


def test_skipping_moves_on_and_the_skipped_one_comes_last(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=3)
    ann = api.member(fleet, "annotator")
    skipped = ask(ann, seed)
    second = ask(ann, seed, skip=skipped["task_id"])
    assert second["vertex"]["id"] == str(seed.vertices[1])
    reply(ann, second)
    reply(ann, ask(ann, seed))
    last = ask(ann, seed)
    assert last["vertex"]["id"] == skipped["vertex"]["id"]
    assert ask(ann, seed, skip=last["task_id"]) is None
    assert ask(ann, seed)["vertex"]["id"] == skipped["vertex"]["id"]


def test_a_skipped_vertex_is_free_for_others_at_once(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=1)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    held = ask(one, seed)
    assert ask(two, seed) is None
    assert ask(one, seed, skip=held["task_id"]) is None
    assert ask(two, seed)["vertex"]["id"] == str(seed.vertices[0])


def test_nobody_gets_what_enough_others_hold_or_have_answered(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=2, marks_per_vertex=2)
    one, two, three = (api.member(fleet, "annotator", name) for name in ("one", "two", "three"))
    tasks = [ask(person, seed) for person in (one, two, three)]
    assert [task["vertex"]["id"] for task in tasks] == [str(seed.vertices[n]) for n in (0, 0, 1)]
    reply(one, tasks[0])
    assert ask(one, seed)["vertex"]["id"] == str(seed.vertices[1])
    reply(three, tasks[2])
    assert ask(three, seed) is None
    let_leases_end(api)
    assert ask(three, seed)["vertex"]["id"] == str(seed.vertices[0])


def test_a_lease_counts_in_every_detection_run_of_the_recording(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=1)
    again = seed_detection(api.database, fleet, seed.recording_id, seed.apexes)
    ask(api.member(fleet, "annotator", "one"), seed)
    two = api.member(fleet, "annotator", "two")
    assert two.post(f"/detections/{again}/tasks/next", {"camera": "front"}).status_code == 204


def test_an_answer_is_checked_before_anything_is_kept(api, fleet):
    seed = seed_marking(api.database, fleet)
    ann = api.member(fleet, "annotator")
    task = ask(ann, seed)
    for mark, code in (
        (None, "mark_required"),
        ((639.6, 0.0), "mark_outside_image"),
        ((0.0, -0.51), "mark_outside_image"),
    ):
        answer = reply(ann, task, mark=mark)
        assert (answer.status_code, answer.json()["code"]) == (422, code)
    bad = reply(ann, task, verdict="maybe")
    assert (bad.status_code, bad.json()["code"]) == (422, "invalid_request")
    with api.database.reading() as session:
        assert session.query(Answer).count() == 0
    assert reply(ann, task, mark=(639.5, -0.5)).status_code == 200


def test_tasks_of_others_do_not_exist(api, fleet):
    seed = seed_marking(api.database, fleet)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    task = ask(one, seed)
    assert reply(two, task).status_code == 404


def test_a_late_answer_is_taken_though_others_have_answered_meanwhile(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=1)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    late = ask(one, seed)
    let_leases_end(api)
    assert reply(two, ask(two, seed)).status_code == 200
    assert reply(one, late).json()["version"] == 1
    with api.database.reading() as session:
        assert len(standing(session, "is_mark")) == 2


def test_every_state_of_an_answer_is_kept_and_a_repetition_is_none(api, fleet):
    seed = seed_marking(api.database, fleet)
    ann = api.member(fleet, "annotator")
    task = ask(ann, seed)
    for version, (verdict, mark) in enumerate(
        (("confirmed", (1.0, 1.0)), ("confirmed", (1.0, 1.0)), ("confirmed", (2.0, 1.0)), ("rejected", None))
    ):
        assert reply(ann, task, verdict, mark, version).status_code == 200
    with api.database.reading() as session:
        rows = session.query(Answer).order_by(Answer.version)
        kept = [(row.version, row.verdict, row.u, row.is_mark, row.is_verdict) for row in rows]
    assert kept == [
        (1, "confirmed", 1.0, False, False),
        (2, "confirmed", 1.0, False, False),
        (3, "confirmed", 2.0, True, False),
        (4, "rejected", None, False, True),
    ]


def test_progress_counts_vertices_and_answers(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=4, marks_per_vertex=2)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    said = (
        (one, 0, "confirmed", (1.0, 1.0)),
        (two, 0, "confirmed", (2.0, 2.0)),
        (one, 1, "rejected", None),
        (one, 2, "unsure", None),
        (two, 3, "confirmed", None),
    )
    for person, number, verdict, mark in said:
        seed_answer(api.database, seed, person.person_id, number, verdict, mark)
    progress = one.get(f"/detections/{seed.detection_id}/progress?camera=front").json()
    assert progress == {"vertices": 4, "marks_wanted": 2, "answered": 3, "by_machine": 0, "mine": 3, "complete": 1}
    answered = two.get(f"/detections/{seed.detection_id}/answered?camera=front").json()
    assert answered == {"sweeps": [0, 1, 2], "mine": [0]}
    tally = api.member(fleet, "reviewer").get(f"/detections/{seed.detection_id}/tally?camera=front").json()
    assert tally == {
        "answers": 4,
        "confirmed": 2,
        "rejected": 1,
        "unsure": 1,
        "marks": 2,
        "reviewed": 0,
        "people": [{"name": "one", "answers": 3}, {"name": "two", "answers": 1}],
    }
    told = reply(one, ask(one, seed)).json()["progress"]
    assert told == {"vertices": 4, "marks_wanted": 2, "answered": 4, "by_machine": 0, "mine": 4, "complete": 1}
    assert told == one.get(f"/detections/{seed.detection_id}/progress?camera=front").json()


def test_a_detection_that_is_not_done_hands_nothing_out(api, fleet):
    seed = seed_marking(api.database, fleet)
    with api.database.writing() as session:
        session.get_one(Detection, seed.detection_id).state = "running"
    answer = api.member(fleet, "annotator").post(f"/detections/{seed.detection_id}/tasks/next", {"camera": "front"})
    assert (answer.status_code, answer.json()["code"]) == (409, "detection_not_done")


def test_asking_for_more_marks_opens_the_vertices_again(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=1)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    reply(one, ask(one, seed))
    assert ask(two, seed) is None
    with api.database.writing() as session:
        session.get_one(Recording, seed.recording_id).marks_per_vertex = 2
    assert ask(two, seed) is not None
    assert ask(one, seed) is None


def test_a_vertex_without_a_frame_is_not_handed_out(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=1)
    with api.database.writing() as session:
        session.query(VertexFrame).delete()
    assert ask(api.member(fleet, "annotator"), seed) is None


def test_a_mark_in_another_frame_answers_nothing(api, fleet):
    seed = seed_marking(api.database, fleet, vertices=3)
    one, two = api.member(fleet, "annotator", "one"), api.member(fleet, "annotator", "two")
    seed_answer(api.database, seed, one.person_id, 0, "confirmed", None)
    seed_answer(api.database, seed, one.person_id, 1, "unsure", (5.0, 5.0))
    assert ask(two, seed)["vertex"]["id"] == str(seed.vertices[0])
    assert ask(one, seed)["vertex"]["id"] == str(seed.vertices[2])
