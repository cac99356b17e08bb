"""Marking: tasks one after the other, and marks and verdicts by their own addresses."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Query, Request, Response

from service.annotations import direct
from service.annotations.handout import is_open, lock_recording, next_task
from service.annotations.progress import marks_of_others, progress, visible_answers
from service.annotations.schemas import (
    Answer,
    AnswerView,
    GivenMark,
    NextTask,
    Progress,
    TaskView,
)
from service.annotations.views import find_frame, find_task, mark_view, task_view
from service.annotations.writing import write_mark, write_verdict
from service.auth.access import ReadAccess, WriteAccess
from service.auth.roles import rank
from service.db.annotations import Verdict
from service.db.clock import now
from service.db.detections import Apex, Detection
from service.detections.queries import done_detection, find_camera
from service.events.hints import hint
from service.http.pages import LongPaging, Page, fetch
from service.http.problems import Problem
from service.http.schemas import Sought

router = APIRouter(tags=["annotations"])
router.include_router(direct.router)

CameraQuery = Annotated[Sought, Query(description="a camera's name in the rig")]


@router.post(
    "/detections/{detection_id}/tasks/next",
    response_model=TaskView,
    responses={204: {"description": "nothing is left for this person"}},
)
def ask_task(detection_id: UUID, wanted: NextTask, access: WriteAccess, request: Request) -> TaskView | Response:
    """The next vertex for this person to judge, leased to them; the one that they hold, renewed. [annotator]"""
    detection = done_detection(access, detection_id, "annotator")
    camera = find_camera(access.session, detection.recording_id, wanted.camera)
    lease_s = request.app.state.settings.mark_lease_s
    task = next_task(access.session, detection, camera, access.person.id, lease_s, wanted.skip)
    if task is None:
        return Response(status_code=204)
    return task_view(access.session, task)


@router.post("/tasks/{task_id}/answer")
def answer_task(task_id: UUID, answer: Answer, access: WriteAccess) -> AnswerView:
    """Judge a vertex. A lease that ran out does no harm as long as the vertex still takes answers. [annotator]"""
    session, me = access.session, access.person.id
    task, detection = find_task(access, task_id)
    found = find_frame(session, task.vertex_id, task.sensor_id)
    recording = lock_recording(session, detection.recording_id)
    if not is_open(session, found.vertex, found.camera.id, me, recording.marks_per_vertex):
        raise Problem(
            409,
            "vertex_taken",
            "Your lease on this vertex ran out, and meanwhile as many others as wanted have answered it.",
            "Nothing is lost but this one answer: ask for the next task.",
        )
    if answer.verdict == "confirmed" and answer.mark is None:
        raise Problem(
            422, "mark_required", "A confirmed vertex needs its mark.", 'Send "mark": {"u": ..., "v": ...} in pixels.'
        )
    mark = None
    if answer.verdict == "confirmed" and answer.mark is not None:
        mark = write_mark(session, me, found.camera, found.frame, answer.mark.u, answer.mark.v)
    verdict = write_verdict(session, me, session.get_one(Apex, found.vertex.apex_id), answer.verdict)
    task.answered_at = now()  # pyright: ignore[reportAttributeAccessIssue] - the database's own clock
    session.flush()
    hint(session, detection.fleet_id, "detection", detection.id)
    return AnswerView(
        mark=mark_view(mark),
        verdict=verdict.verdict,  # pyright: ignore[reportArgumentType] - the column holds only verdicts
        progress=progress(session, detection, found.camera, me),
        # Not to who is unsure: they may still decide, and by themselves.
        others=[] if answer.verdict == "unsure" else marks_of_others(session, me, found.camera.id, found.frame.index),
    )


@router.get("/detections/{detection_id}/progress")
def read_progress(detection_id: UUID, access: ReadAccess, camera: CameraQuery) -> Progress:
    """How far the marking is in one camera."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    return progress(access.session, detection, sensor, access.person.id)


@router.get("/detections/{detection_id}/marks")
def list_marks(detection_id: UUID, access: ReadAccess, window: LongPaging, camera: CameraQuery) -> Page[GivenMark]:
    """Answers in one camera: one's own, others' on vertices that one confirmed or rejected; reviewers see all."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera)
    everyone = rank(access.role(detection.fleet_id) or "") >= rank("reviewer")
    statement = visible_answers(detection.id, sensor.id, access.person.id, everyone=everyone)
    rows, following = fetch(access.session, statement, Verdict.id, window)
    items = [
        GivenMark(
            vertex_id=vertex_id,
            person=name,
            own=verdict.person_id == access.person.id,
            verdict=verdict.verdict,
            frame_index=frame_index,
            mark=mark_view(mark) if verdict.verdict == "confirmed" else None,
        )
        for verdict, vertex_id, frame_index, mark, name in rows
    ]
    return Page(items=items, next=following)
