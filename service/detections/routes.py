"""Detections and their vertices."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Query, Request
from fastapi.responses import JSONResponse, Response
from sqlalchemy import select
from sqlalchemy.orm import load_only, undefer

from apexcal.documents.base import Sought
from apexcal.documents.detections import (
    DetectionEdit,
    DetectionRequest,
    DetectionView,
    Quality,
    VertexSummary,
    VertexView,
)
from service.detections.actions import ask_corners, new_detection
from service.detections.jobs import queue_detection
from service.detections.queries import done_detection, vertices_of
from service.detections.views import SUMMARY, detection_views, vertex_views
from service.platform.auth.access import ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.detections import Detection, Vertex
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Recording
from service.platform.http.pages import LongPaging, Page, Paging, compressed, fetch
from service.platform.http.problems import not_found
from service.platform.http.router import DOCUMENT, Router
from service.platform.jobs.queue import cancel
from service.recordings.actions import delete_detection
from service.recordings.queries import find_camera, lidar_of, ready_recording

router = Router(tags=["detections"])

Camera = Annotated[Sought | None, Query(description="a camera's name in the rig")]
Joint = Annotated[bool, Query(description="with the covariance that the corners of each vertex share")]


@router.post(
    "/recordings/{recording_id}/detections", status_code=202, response_model=DetectionView, max_body_size=DOCUMENT
)
def ask_detection(recording_id: UUID, body: DetectionRequest, access: WriteAccess) -> JSONResponse:
    """Find the board's vertices in a recording. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    rig = access.session.get_one(Rig, recording.rig_id)
    lidar = lidar_of(access.session, recording.id)
    detection = new_detection(recording, lidar, rig, body, access.person.id)
    access.session.add(detection)
    access.session.flush()
    queue_detection(access.session, detection)
    return access.answer(detection_views(access.session, [detection])[0], 202)


@router.get("/recordings/{recording_id}/detections")
def list_detections(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[DetectionView]:
    """The detections of a recording, newest first."""
    recording = access.find(Recording, recording_id)
    statement = select(Detection).where(Detection.recording_id == recording.id)
    rows, following = fetch(access.session, statement, Detection.id, window, newest_first=True)
    return Page(items=detection_views(access.session, rows), next=following)


@router.get("/detections/{detection_id}")
def read_detection(detection_id: UUID, access: ReadAccess) -> DetectionView:
    """A detection: its state, and its counts once it is done."""
    detection = access.find(Detection, detection_id)
    return detection_views(access.session, [detection])[0]


@router.patch("/detections/{detection_id}")
def edit_detection(detection_id: UUID, body: DetectionEdit, access: WriteAccess) -> DetectionView:
    """Say which corners of the board people are to mark. Existing marks stay. [engineer]"""
    detection = done_detection(access, detection_id, "engineer")
    ask_corners(access.session, detection, body.marked_corners)
    hint(access.session, detection.fleet_id, "detection", detection.id)
    return detection_views(access.session, [detection])[0]


@router.post("/detections/{detection_id}/cancel", status_code=202)
def cancel_detection(detection_id: UUID, access: WriteAccess) -> DetectionView:
    """Ask for the end of a detection; one that has ended stays as it is. [engineer]"""
    detection = access.find(Detection, detection_id, "engineer")
    cancel(access.session, [detection.id])
    hint(access.session, detection.fleet_id, "detection", detection.id)
    return detection_views(access.session, [detection])[0]


@router.delete("/detections/{detection_id}", status_code=204)
def remove_detection(detection_id: UUID, access: WriteAccess) -> None:
    """Delete a detection with its pairs and calibrations, unless one is published. Marks stay. [engineer]"""
    detection = access.find(Detection, detection_id, "engineer")
    recording = access.session.get_one(Recording, detection.recording_id)
    hint(access.session, detection.fleet_id, "detection", detection_id)
    delete_detection(access.session, detection, recording.vehicle_id)


@router.get("/detections/{detection_id}/vertices", response_model=Page[VertexSummary])
def list_vertices(
    detection_id: UUID,
    access: ReadAccess,
    window: LongPaging,
    request: Request,
    camera: Camera = None,
    quality: Quality | None = None,
) -> Response:
    """A detection's vertices in the order of marking; with `camera` only those with a frame of that camera."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera) if camera is not None else None
    vertices = vertices_of(detection, sensor, quality).options(load_only(*SUMMARY))
    rows, following = fetch(access.session, vertices, Vertex.rank, window)
    items = [VertexSummary.model_validate(row, from_attributes=True) for row in rows]
    return compressed(request, Page(items=items, next=following))


@router.get("/detections/{detection_id}/vertices/details", operation_id="vertices.list_details")
def list_vertex_details(
    detection_id: UUID,
    access: ReadAccess,
    window: LongPaging,
    camera: Camera = None,
    quality: Quality | None = None,
    joint: Joint = False,
) -> Page[VertexView]:
    """The same with covariances, frames and the board's other corners: some kB for each vertex."""
    detection = access.find(Detection, detection_id)
    sensor = find_camera(access.session, detection.recording_id, camera) if camera is not None else None
    vertices = vertices_of(detection, sensor, quality)
    if joint:
        vertices = vertices.options(undefer(Vertex.corner_covariance))
    rows, following = fetch(access.session, vertices, Vertex.rank, window)
    return Page(items=vertex_views(access.session, rows, sensor, joint=joint), next=following)


@router.get("/detections/{detection_id}/vertices/{vertex_id}")
def read_vertex(detection_id: UUID, vertex_id: UUID, access: ReadAccess) -> VertexView:
    """A vertex with its details."""
    detection = access.find(Detection, detection_id)
    vertex = access.session.get(Vertex, vertex_id)
    if vertex is None or vertex.detection_id != detection.id:
        raise not_found()
    return vertex_views(access.session, [vertex], None)[0]
