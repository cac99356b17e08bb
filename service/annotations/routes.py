"""Routes of marking: next task, answer, undo, progress, marks."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Query, Request, Response

from apexcal.documents.base import Sought
from apexcal.documents.marking import (
    Answer,
    AnsweredSweeps,
    AnswerView,
    GivenMark,
    NextTask,
    Progress,
    Tally,
    TaskView,
    Undo,
)
from service.annotations.answer_actions import create_answer, undo
from service.annotations.answer_queries import VERDICT
from service.annotations.disclosure_actions import DisclosureKey, answered_by_others, disclose
from service.annotations.locks import lock_person
from service.annotations.progress_actions import read_progress
from service.annotations.tally_queries import answered_sweeps, tally, visible_answers
from service.annotations.task_actions import next_tasks
from service.annotations.views import Subject, find_subject, is_machine, mark_view, task_view
from service.detections.queries import done_detection
from service.platform.auth.access import Access, ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.detections import Detection
from service.platform.db.recordings import Recording
from service.platform.http.pages import LongPaging, Page, fetch
from service.platform.http.router import MarkingRoute, Router
from service.recordings.queries import find_camera

router = Router(tags=["annotations"], route_class=MarkingRoute)

CameraQuery = Annotated[Sought, Query(description="a camera's name in the rig")]


@router.post(
    "/detections/{detection_id}/tasks/next",
    response_model=TaskView,
    responses={204: {"description": "nothing is left for this person"}},
)
def ask_task(detection_id: UUID, body: NextTask, access: WriteAccess, request: Request) -> TaskView | Response:
    """The next vertex for this person to judge, leased to them; the one that they hold, renewed. [annotator]

    ``ahead`` further tasks are leased and answered, in the order in which they will come. ``vertex_id`` comes first.
    """
    detection = done_detection(access, detection_id, "annotator")
    camera = find_camera(access.session, detection.recording_id, body.camera)
    lease_s = request.app.state.settings.mark_lease_s
    wishes = (body.skip, body.ahead, body.vertex_id)
    tasks = next_tasks(access.session, detection, camera, access.person.id, lease_s, *wishes)
    if not tasks:
        return Response(status_code=204)
    first, *ahead = map(task_view, tasks)
    return first.model_copy(update={"ahead": ahead})


@router.post("/tasks/{task_id}/answer")
def answer_task(task_id: UUID, answer: Answer, access: WriteAccess) -> AnswerView:
    """Judge a vertex: verdict and mark at once. The same id again is the same answer. [annotator]"""
    subject = _locked(access, task_id)
    view = create_answer(access.session, subject, answer)
    hint(access.session, subject.fleet_id, "marking", subject.detection_id)
    return view


@router.post("/tasks/{task_id}/undo")
def undo_answer(task_id: UUID, answer: Undo, access: WriteAccess, request: Request) -> TaskView:
    """Take one's own last answer back; its vertex is leased to the same person at once. [annotator]"""
    subject = _locked(access, task_id)
    again = undo(access.session, subject, answer, request.app.state.settings.mark_lease_s)
    hint(access.session, subject.fleet_id, "marking", subject.detection_id)
    return task_view(again)


def _locked(access: Access, task_id: UUID) -> Subject:
    lock_person(access.session, access.person.id)
    return find_subject(access, task_id)


@router.get("/detections/{detection_id}/progress")
def get_progress(detection_id: UUID, access: ReadAccess, camera: CameraQuery, request: Request) -> Progress:
    """How far the marking is in one camera."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    return read_progress(access, request.app.state.database, detection, sensor)


@router.get("/detections/{detection_id}/answered")
def get_answered(detection_id: UUID, access: ReadAccess, camera: CameraQuery) -> AnsweredSweeps:
    """Which sweeps have answers in one camera, and which have yours. It says nothing of what anybody answered."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    return answered_sweeps(access.session, detection.id, sensor.id, access.person.id)


@router.get("/detections/{detection_id}/tally")
def read_tally(detection_id: UUID, access: ReadAccess, camera: CameraQuery, request: Request) -> Tally:
    """What people said in one camera, in numbers. What one answers afterwards counts as reviewed. [reviewer]"""
    detection = access.find(Detection, detection_id, "reviewer")
    sensor = find_camera(access.session, detection.recording_id, camera)
    counts = tally(access.session, detection.id, sensor.id)
    others = answered_by_others(access.session, detection.id, sensor.id, access.person.id)
    disclose(access, request.app.state.database, sensor, others, "tally")
    return counts


@router.get("/detections/{detection_id}/marks")
def list_marks(
    detection_id: UUID, access: ReadAccess, window: LongPaging, camera: CameraQuery, request: Request
) -> Page[GivenMark]:
    """Answers in one camera: one's own, and others' on complete vertices that one decided; reviewers see all.

    What one answers afterwards on a vertex where others' answers were told counts as reviewed.
    """
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    everyone = access.sees_answers(detection.fleet_id)
    per_vertex = access.session.get_one(Recording, detection.recording_id).marks_per_vertex
    statement = visible_answers(detection.id, sensor.id, access.person.id, per_vertex, everyone=everyone)
    rows, following = fetch(access.session, statement, VERDICT.id, window)
    items = [
        GivenMark(
            vertex_id=vertex_id,
            person=name,
            own=verdict.person_id == access.person.id,
            verdict=verdict.verdict,
            frame_index=frame_index,
            mark=mark_view(mark) if verdict.verdict == "confirmed" and (everyone or not is_machine(mark)) else None,
            reviewed=reviewed,
            told_at=told_at,
            is_machine=verdict.verdict == "confirmed" and is_machine(mark),
            corner=corner,
        )
        for verdict, vertex_id, frame_index, mark, name, reviewed, told_at, _, corner in rows
    ]
    others = {DisclosureKey(row[2], *row[7:]) for row, item in zip(rows, items, strict=True) if not item.own}
    disclose(access, request.app.state.database, sensor, others, "marks")
    return Page(items=items, next=following)
