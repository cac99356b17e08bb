"""Studies of a recording: each is asked for with POST, and read until its state is done or failed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar
from uuid import UUID

from fastapi import APIRouter
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.studies import (
    OffsetRequest,
    OffsetView,
    PreviewRequest,
    PreviewView,
    StudyView,
    SuggestionRequest,
    SuggestionView,
)
from apexcal.documents.sweeps import PackingView
from service.auth.access import Access, ReadAccess, WriteAccess
from service.db.jobs import Job
from service.db.recordings import Recording
from service.db.studies import Study
from service.detections.queries import done_detection, find_camera, ready_recording
from service.http.bodies import DOCUMENT
from service.http.pages import Page, Paging, Window, fetch
from service.http.problems import not_found
from service.studies.jobs import queue_packing, queue_study
from service.studies.offset_queries import what_is_known
from service.studies.views import offset_view, packing_view, preview_view, suggestion_view

router = APIRouter(tags=["studies"])

View = TypeVar("View", bound=StudyView)


@router.post(
    "/recordings/{recording_id}/region-previews",
    status_code=202,
    response_model=PreviewView,
    max_body_size=DOCUMENT,
)
def ask_preview(recording_id: UUID, wanted: PreviewRequest, access: WriteAccess) -> JSONResponse:
    """Count what a region keeps. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    row, job = _ask(access, recording, "preview", {"region": wanted.region})
    return access.answer(preview_view(row, job), 202)


@router.get("/region-previews/{preview_id}")
def read_preview(preview_id: UUID, access: ReadAccess) -> PreviewView:
    """A region preview."""
    return preview_view(*_read(access, preview_id, "preview"))


@router.post("/recordings/{recording_id}/region-suggestions", status_code=202, response_model=SuggestionView)
def ask_suggestion(recording_id: UUID, access: WriteAccess, wanted: SuggestionRequest | None = None) -> JSONResponse:
    """Compute a region from what moves against the still background. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    row, job = _ask(access, recording, "suggestion", {})
    return access.answer(suggestion_view(row, job), 202)


@router.get("/region-suggestions/{suggestion_id}")
def read_suggestion(suggestion_id: UUID, access: ReadAccess) -> SuggestionView:
    """A suggested region."""
    return suggestion_view(*_read(access, suggestion_id, "suggestion"))


@router.post("/recordings/{recording_id}/clock-offsets", status_code=202, response_model=OffsetView)
def ask_offset(recording_id: UUID, wanted: OffsetRequest, access: WriteAccess) -> JSONResponse:
    """Estimate how far the camera's clock is ahead of the LiDAR's, from vertices and their marks. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    detection = done_detection(access, wanted.detection_id, "engineer")
    if detection.recording_id != recording.id:
        raise not_found()
    camera = find_camera(access.session, recording.id, wanted.camera)
    asked = what_is_known(access.session, recording, detection, camera, wanted.model)
    row, job = _ask(access, recording, "clock_offset", asked, detection.id)
    return access.answer(offset_view(row, job), 202)


@router.get("/recordings/{recording_id}/clock-offsets")
def list_offsets(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[OffsetView]:
    """The clock offsets that were estimated of a recording, newest first."""
    return _list(access, recording_id, "clock_offset", window, offset_view)


@router.get("/clock-offsets/{offset_id}")
def read_offset(offset_id: UUID, access: ReadAccess) -> OffsetView:
    """A clock offset."""
    return offset_view(*_read(access, offset_id, "clock_offset"))


@router.post("/recordings/{recording_id}/sweep-packings", status_code=202, response_model=PackingView)
def ask_packing(recording_id: UUID, access: WriteAccess) -> JSONResponse:
    """Pack a recording's sweeps, so that they can be read. A packed recording stays as it is. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    row, job = queue_packing(access.session, recording)
    return access.answer(packing_view(row, job), 202)


@router.get("/recordings/{recording_id}/sweep-packings")
def list_packings(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[PackingView]:
    """The packings of a recording's sweeps, newest first."""
    return _list(access, recording_id, "packing", window, packing_view)


@router.get("/sweep-packings/{packing_id}")
def read_packing(packing_id: UUID, access: ReadAccess) -> PackingView:
    """A packing of a recording's sweeps."""
    return packing_view(*_read(access, packing_id, "packing"))


def _list(
    access: Access, recording_id: UUID, kind: str, window: Window, view: Callable[[Study, Job | None], View]
) -> Page[View]:
    recording = access.find(Recording, recording_id)
    statement = select(Study).where(Study.recording_id == recording.id, Study.kind == kind)
    rows, following = fetch(access.session, statement, Study.id, window, newest_first=True)
    jobs = {
        job.id: job for job in access.session.scalars(select(Job).where(Job.id.in_([row.job_id for row in rows])))
    }
    return Page(items=[view(row, jobs.get(row.job_id or 0)) for row in rows], next=following)


def _ask(
    access: Access, recording: Recording, kind: str, asked: dict[str, Any], detection_id: UUID | None = None
) -> tuple[Study, Job]:
    row = Study(
        fleet_id=recording.fleet_id,
        recording_id=recording.id,
        detection_id=detection_id,
        kind=kind,
        asked=asked,
    )
    access.session.add(row)
    access.session.flush()
    return row, queue_study(access.session, row)


def _read(access: Access, study_id: UUID, kind: str) -> tuple[Study, Job | None]:
    row = access.find(Study, study_id)
    if row.kind != kind:
        raise not_found()
    return row, access.session.get(Job, row.job_id) if row.job_id else None
