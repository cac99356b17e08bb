"""Studies of a recording: each is asked for with POST, and read until its state is done or failed."""

from __future__ import annotations

from uuid import UUID

from fastapi.responses import JSONResponse

from apexcal.documents.studies import (
    OffsetRequest,
    OffsetView,
    PreviewRequest,
    PreviewView,
    SuggestionRequest,
    SuggestionView,
)
from apexcal.documents.sweeps import PackingView
from service.detections.queries import done_detection, find_camera, ready_recording
from service.platform.auth.access import ReadAccess, WriteAccess
from service.platform.http.bodies import DOCUMENT
from service.platform.http.pages import Page, Paging
from service.platform.http.problems import not_found
from service.platform.http.router import Router
from service.studies.jobs import queue_packing
from service.studies.offset_queries import what_is_known
from service.studies.queries import list_studies, new_study, read_study
from service.studies.views import offset_view, packing_view, preview_view, suggestion_view

router = Router(tags=["studies"])


@router.post(
    "/recordings/{recording_id}/region-previews",
    status_code=202,
    response_model=PreviewView,
    max_body_size=DOCUMENT,
)
def ask_preview(recording_id: UUID, wanted: PreviewRequest, access: WriteAccess) -> JSONResponse:
    """Count what a region keeps. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    row, job = new_study(access, recording, "preview", {"region": wanted.region})
    return access.answer(preview_view(row, job), 202)


@router.get("/region-previews/{preview_id}")
def read_preview(preview_id: UUID, access: ReadAccess) -> PreviewView:
    """A region preview."""
    return preview_view(*read_study(access, preview_id, "preview"))


@router.post("/recordings/{recording_id}/region-suggestions", status_code=202, response_model=SuggestionView)
def ask_suggestion(recording_id: UUID, access: WriteAccess, wanted: SuggestionRequest | None = None) -> JSONResponse:
    """Compute a region from what moves against the still background. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    row, job = new_study(access, recording, "suggestion", {})
    return access.answer(suggestion_view(row, job), 202)


@router.get("/region-suggestions/{suggestion_id}")
def read_suggestion(suggestion_id: UUID, access: ReadAccess) -> SuggestionView:
    """A suggested region."""
    return suggestion_view(*read_study(access, suggestion_id, "suggestion"))


@router.post("/recordings/{recording_id}/clock-offsets", status_code=202, response_model=OffsetView)
def ask_offset(recording_id: UUID, wanted: OffsetRequest, access: WriteAccess) -> JSONResponse:
    """Estimate how far the camera's clock is ahead of the LiDAR's, from vertices and their marks. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    detection = done_detection(access, wanted.detection_id, "engineer")
    if detection.recording_id != recording.id:
        raise not_found()
    camera = find_camera(access.session, recording.id, wanted.camera)
    asked = what_is_known(access.session, recording, detection, camera, wanted.model)
    row, job = new_study(access, recording, "clock_offset", asked, detection.id)
    return access.answer(offset_view(row, job), 202)


@router.get("/recordings/{recording_id}/clock-offsets")
def list_offsets(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[OffsetView]:
    """The clock offsets that were estimated of a recording, newest first."""
    return list_studies(access, recording_id, "clock_offset", window, offset_view)


@router.get("/clock-offsets/{offset_id}")
def read_offset(offset_id: UUID, access: ReadAccess) -> OffsetView:
    """A clock offset."""
    return offset_view(*read_study(access, offset_id, "clock_offset"))


@router.post("/recordings/{recording_id}/sweep-packings", status_code=202, response_model=PackingView)
def ask_packing(recording_id: UUID, access: WriteAccess) -> JSONResponse:
    """Pack a recording's sweeps, so that they can be read. A packed recording stays as it is. [engineer]"""
    recording = ready_recording(access, recording_id, "engineer")
    row, job = queue_packing(access.session, recording)
    return access.answer(packing_view(row, job), 202)


@router.get("/recordings/{recording_id}/sweep-packings")
def list_packings(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[PackingView]:
    """The packings of a recording's sweeps, newest first."""
    return list_studies(access, recording_id, "packing", window, packing_view)


@router.get("/sweep-packings/{packing_id}")
def read_packing(packing_id: UUID, access: ReadAccess) -> PackingView:
    """A packing of a recording's sweeps."""
    return packing_view(*read_study(access, packing_id, "packing"))
