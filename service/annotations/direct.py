"""Marks and verdicts by their own addresses: a person's own, versioned, whether or not a task led to them."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Path, Request, Response

from service.annotations.schemas import MarkView, Pixel, VerdictBody, VerdictView
from service.annotations.writing import find_mark, find_verdict, take_back, write_mark, write_verdict
from service.auth.access import Access, ReadAccess, WriteAccess
from service.auth.roles import Role
from service.db.annotations import Mark
from service.db.detections import Apex, Detection, Vertex
from service.db.recordings import CameraFrame, Recording, Sensor
from service.detections.queries import find_camera
from service.http.etags import Conditional, Conditions, version_etag
from service.http.problems import Problem, not_found
from service.http.schemas import Sought

router = APIRouter()

MARK = "/recordings/{recording_id}/cameras/{camera}/frames/{index}/mark"
FrameIndex = Annotated[int, Path(ge=0, le=2**31 - 1)]


@router.get(MARK)
def read_mark(
    recording_id: UUID, camera: Sought, index: FrameIndex, access: ReadAccess, conditions: Conditional
) -> MarkView:
    """One's own mark in a frame."""
    sensor, frame = _frame(access, recording_id, camera, index, "viewer")
    mark = find_mark(access.session, access.person.id, sensor.id, frame.index)
    if mark is None:
        raise Problem(404, "not_marked", "You have not marked this frame.", "PUT the mark with If-None-Match: *.")
    return _answer(mark, conditions)


@router.put(MARK)
def put_mark(
    recording_id: UUID,
    camera: Sought,
    index: FrameIndex,
    pixel: Pixel,
    access: WriteAccess,
    conditions: Conditional,
    request: Request,
) -> MarkView:
    """Set one's own mark: the first with If-None-Match: *, a correction with If-Match. [annotator]"""
    sensor, frame = _frame(access, recording_id, camera, index, "annotator")
    mark = find_mark(access.session, access.person.id, sensor.id, frame.index)
    _check_edit(mark, pixel, conditions, request)
    return _answer(write_mark(access.session, access.person.id, sensor, frame, pixel.u, pixel.v), conditions)


@router.delete(MARK, status_code=204)
def delete_mark(
    recording_id: UUID,
    camera: Sought,
    index: FrameIndex,
    access: WriteAccess,
    conditions: Conditional,
    request: Request,
) -> Response:
    """Take one's own mark back; the vertex takes an answer again. [annotator]"""
    sensor, frame = _frame(access, recording_id, camera, index, "annotator")
    mark = find_mark(access.session, access.person.id, sensor.id, frame.index)
    if mark is not None:
        if "if-match" in request.headers:
            conditions.require(version_etag(mark.version))
        take_back(access.session, mark)
    return Response(status_code=204)


@router.put("/vertices/{vertex_id}/verdict")
def put_verdict(
    vertex_id: UUID, said: VerdictBody, access: WriteAccess, conditions: Conditional, request: Request
) -> VerdictView:
    """Set one's own verdict on a vertex; If-Match is looked at where it is sent. [annotator]"""
    vertex = _vertex(access, vertex_id)
    known = find_verdict(access.session, access.person.id, vertex.apex_id)
    if "if-match" in request.headers:
        conditions.require(version_etag(known.version if known else 0))
    apex = access.session.get_one(Apex, vertex.apex_id)
    verdict = write_verdict(access.session, access.person.id, apex, said.verdict)
    conditions.offer(version_etag(verdict.version))
    return VerdictView(vertex_id=vertex.id, verdict=said.verdict, version=verdict.version)


@router.delete("/vertices/{vertex_id}/verdict", status_code=204)
def delete_verdict(vertex_id: UUID, access: WriteAccess) -> Response:
    """Take one's own verdict back; the vertex takes an answer again. [annotator]"""
    vertex = _vertex(access, vertex_id)
    verdict = find_verdict(access.session, access.person.id, vertex.apex_id)
    if verdict is not None:
        take_back(access.session, verdict)
    return Response(status_code=204)


def _vertex(access: Access, vertex_id: UUID) -> Vertex:
    vertex = access.session.get(Vertex, vertex_id)
    if vertex is None:
        raise not_found()
    access.find(Detection, vertex.detection_id, "annotator")
    return vertex


def _frame(access: Access, recording_id: UUID, camera: str, index: int, role: Role) -> tuple[Sensor, CameraFrame]:
    recording = access.find(Recording, recording_id, role)
    sensor = find_camera(access.session, recording.id, camera)
    frame = access.session.get(CameraFrame, (sensor.id, index))
    if frame is None:
        raise Problem(
            404,
            "no_such_frame",
            f"The camera {camera} has no frame {index}.",
            f"Its frames are 0 to {sensor.count - 1}.",
        )
    return sensor, frame


def _check_edit(mark: Mark | None, pixel: Pixel, conditions: Conditions, request: Request) -> None:
    if mark is None:
        if "if-match" in request.headers:
            conditions.require('"none"')
        return
    if (mark.u, mark.v) == (pixel.u, pixel.v):
        return  # the same request once more, after an answer that was lost: RFC 9110, 13.1.1
    if conditions.creates_only():
        raise Problem(
            412,
            "version_conflict",
            "You have marked this frame already.",
            "Read the mark and send its ETag as If-Match to correct it.",
        )
    conditions.require(version_etag(mark.version))


def _answer(mark: Mark, conditions: Conditions) -> MarkView:
    conditions.offer(version_etag(mark.version))
    return MarkView(u=mark.u, v=mark.v, version=mark.version)
