"""A fit by itself: queued where enough marks came, done by a worker, shown without any mark."""

import json
from uuid import UUID

import pytest
from sqlalchemy import update

from service.analyses.precision import queue_due_fits
from service.platform.db.analyses import Analysis
from service.platform.db.annotations import Answer, MarkingProgress
from service.platform.db.calibrations import Calibration, CorrespondenceSet
from service.platform.db.jobs import Job
from tests.contract.test_analyses import FRAMES, seed_walk
from tests.support.work import work

RESULT = {"answered", "pairs", "error_20m_mm", "doubts", "next_steps"}


@pytest.fixture
def walk(api, fleet, engineer, annotator):
    """A still detection whose every frame the engineer marked; somebody else's look counted its progress."""
    recording_id, detection_id = seed_walk(api.database, fleet, engineer.person_id, offset_s=0.0)
    address = f"/detections/{detection_id}/progress"
    assert annotator.get(address, params={"camera": "front"}).json()["answered"] == FRAMES
    return recording_id, detection_id


@pytest.fixture
def annotator(api, fleet):
    return api.member(fleet, "annotator")


def read(client, recording_id):
    return client.get("/analyses", params={"recording_id": str(recording_id), "kind": "precision"}).json()["items"]


def marked(api, detection_id, answered):
    with api.database.writing() as session:
        of = update(MarkingProgress).where(MarkingProgress.detection_id == detection_id)
        session.execute(of.where(MarkingProgress.vertices.is_not(None)).values(answered=answered))


def test_marks_are_fitted_once_and_anew_when_a_fifth_more_came(api, context, annotator, walk):
    recording_id, detection_id = walk
    queue_due_fits(api.database)
    queue_due_fits(api.database)
    (queued,) = read(annotator, recording_id)
    assert (queued["state"], queued["camera"], queued["result"]) == ("queued", "front", None)
    work(context)
    (done,) = read(annotator, recording_id)
    assert (done["state"], done["problem"]) == ("done", None)
    result = done["result"]
    assert set(result) == RESULT and (result["answered"], result["pairs"]) == (FRAMES, FRAMES)
    assert 0 < result["error_20m_mm"] < 200 and result["next_steps"]["half_width_deg"] > 0
    for more, state in ((29, "done"), (30, "queued")):
        marked(api, detection_id, FRAMES + more)
        queue_due_fits(api.database)
        (again,) = read(annotator, recording_id)
        assert (again["id"], again["state"], again["result"]) == (done["id"], state, result)
    # Nobody asked for a calibration, and there is none.
    with api.database.reading() as session:
        assert session.query(Calibration).count() == session.query(CorrespondenceSet).count() == 0


def test_no_answer_holds_a_mark(api, context, annotator, walk):
    queue_due_fits(api.database)
    answers = [json.dumps(read(annotator, walk[0]))]
    with api.database.reading() as session:
        row = session.query(Analysis).one()
        marks = [str(value) for name in "uv" for value in row.single_pairs[name]]
        id, job_id = row.id, row.job_id
    work(context)
    answers += [json.dumps(read(annotator, walk[0])), annotator.get(f"/analyses/{id}").text]
    answers.append(annotator.get(f"/jobs/{job_id}").text)
    assert len(marks) == 2 * FRAMES and not [mark for mark in marks for answer in answers if mark in answer]
    with api.database.reading() as session:
        assert session.query(Analysis).one().single_pairs is None


def test_a_calibration_goes_first(api, fleet, annotator, walk):
    with api.database.writing() as session:
        session.add(Job(kind="solve", queue="solve", fleet_id=fleet, subject_id=UUID(int=1), payload={}))
    queue_due_fits(api.database)
    assert read(annotator, walk[0]) == []


def test_marks_that_make_too_few_pairs_are_looked_at_once(api, annotator, walk):
    with api.database.writing() as session:
        session.execute(update(Answer).where(Answer.frame_index > 4).values(verdict="rejected"))
    for _ in range(2):
        queue_due_fits(api.database)
    (refused,) = read(annotator, walk[0])
    assert (refused["state"], refused["problem"]["code"]) == ("failed", "too_few_pairs")
    with api.database.reading() as session:
        assert session.query(Job).count() == 0
