"""A person's own mark in a frame, set without a task. It has no verdict, so it is no answer."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Path, Query, Request
from sqlalchemy import select

from apexcal.documents.base import Sought
from apexcal.documents.corners import TOP, CornerName
from apexcal.documents.marking import MarkView, Pixel
from apexcal.documents.roles import Role
from service.annotations.answer_actions import MOST_ANSWERS
from service.annotations.disclosure_actions import is_told
from service.annotations.locks import lock_person
from service.annotations.mark_actions import check_inside, find_mark, write_answer
from service.annotations.progress_actions import counted
from service.annotations.views import is_machine, mark_view
from service.platform.auth.access import Access, ReadAccess, WriteAccess
from service.platform.db.annotations import Answer
from service.platform.db.base import new_id
from service.platform.db.detections import Apex
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from service.platform.http.etags import Conditional, Conditions, version_etag
from service.platform.http.problems import Problem, conflict, not_found
from service.platform.http.router import MarkingRoute, Router
from service.recordings.queries import find_camera

router = Router(tags=["annotations"], route_class=MarkingRoute)

MARK = "/recordings/{recording_id}/cameras/{camera}/frames/{index}/mark"
FrameIndex = Annotated[int, Path(ge=0, le=2**31 - 1)]
Corner = Annotated[CornerName, Query(description="the board's corner that is marked")]


@router.get(MARK)
def read_mark(
    recording_id: UUID,
    camera: Sought,
    index: FrameIndex,
    access: ReadAccess,
    conditions: Conditional,
    corner: Corner = TOP,
) -> MarkView:
    """Your own mark of a corner in a frame."""
    sensor, frame = _frame(access, recording_id, camera, index, "viewer")
    mark = find_mark(access.session, access.person.id, sensor.id, frame.index, corner)
    if mark is None or is_machine(mark):
        raise not_found("not_marked", "You have not marked this frame.", "PUT the mark with If-None-Match: *.")
    return _answer(mark_view(mark), conditions)


@router.put(MARK)
def put_mark(
    recording_id: UUID,
    camera: Sought,
    index: FrameIndex,
    pixel: Pixel,
    access: WriteAccess,
    conditions: Conditional,
    request: Request,
    corner: Corner = TOP,
) -> MarkView:
    """Set your own mark: the first with If-None-Match: *, a correction with If-Match. [annotator]

    If you have answered the vertex's task, change the mark by answering again, not here.
    """
    sensor, frame = _frame(access, recording_id, camera, index, "annotator")
    session, me = access.session, access.person.id
    lock_person(session, me)
    mark = find_mark(session, me, sensor.id, frame.index, corner)
    _check_edit(mark, pixel, conditions, request)
    if mark is not None and (mark.u, mark.v) == (pixel.u, pixel.v):
        return _answer(mark_view(mark), conditions)
    _check_no_answer(access, sensor, frame, corner, mark)
    check_inside(pixel.u, pixel.v, frame.width, frame.height)
    row = {"recording_id": recording_id, "person_id": me, "sensor_id": sensor.id, "frame_index": frame.index}
    row |= {"id": new_id(), "corner": corner, "u": pixel.u, "v": pixel.v, "version": mark.version + 1 if mark else 1}
    row["reviewed"] = bool(session.scalar(select(is_told(me, sensor.id, frame.index, corner))))
    with counted(session, me, sensor.id, frame.index, corner, None):
        write_answer(session, row, mark, None)
    return _answer(MarkView(u=pixel.u, v=pixel.v, version=row["version"]), conditions)


def _frame(access: Access, recording_id: UUID, camera: str, index: int, role: Role) -> tuple[Sensor, CameraFrame]:
    recording = access.find(Recording, recording_id, role)
    sensor = find_camera(access.session, recording.id, camera)
    frame = access.session.get(CameraFrame, (sensor.id, index))
    if frame is None:
        raise not_found(
            "no_such_frame", f"The camera {camera} has no frame {index}.", f"Its frames are 0 to {sensor.count - 1}."
        )
    return sensor, frame


def _check_no_answer(
    access: Access, camera: Sensor, frame: CameraFrame, corner: CornerName, mark: Answer | None
) -> None:
    own = {"person_id": access.person.id, "sensor_id": camera.id, "frame_index": frame.index}
    of_corner = select(Answer).filter_by(**own).join(Apex, Apex.id == Answer.apex_id).where(Apex.corner == corner)
    rows = access.session.scalars(of_corner.order_by(Answer.version))
    if any(row.verdict for row in {row.apex_id: row for row in rows}.values()):
        raise conflict(
            "answered",
            "This is the mark of a corner that you have answered.",
            "Answer its task again, with the answer's version: POST /v1/tasks/{id}/answer.",
        )
    if mark is not None and mark.version >= MOST_ANSWERS:
        raise conflict(
            "answered_too_often",
            f"You have moved this mark {MOST_ANSWERS} times; it stays where it is.",
            "If it is wrong, ask a reviewer to look at it.",
        )


def _check_edit(mark: Answer | None, pixel: Pixel, conditions: Conditions, request: Request) -> None:
    if mark is None:
        if "if-match" in request.headers:
            conditions.require('"none"')
        return
    if (mark.u, mark.v) == (pixel.u, pixel.v):
        return  # the client repeats a request whose answer was lost: RFC 9110, 13.1.1
    if conditions.creates_only():
        raise Problem(
            412,
            "version_conflict",
            "You have marked this frame already.",
            "Read the mark and send its ETag as If-Match to correct it.",
        )
    conditions.require(version_etag(mark.version))


def _answer(mark: MarkView, conditions: Conditions) -> MarkView:
    conditions.offer(version_etag(mark.version))
    return mark
