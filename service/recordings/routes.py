"""Routes of recordings: make, list, read, change, delete, and read the original back."""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated
from uuid import UUID

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.recordings import (
    CreatedRecording,
    NewRecording,
    RecordingEdit,
    RecordingSummary,
    RecordingView,
)
from apexcal.documents.states import RecordingState
from service.fleets.actions import empty_rig
from service.platform.auth.access import ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.base import new_id
from service.platform.db.clock import now
from service.platform.db.fleets import Rig, Vehicle
from service.platform.db.recordings import Recording
from service.platform.http.etags import Conditional, version_etag
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.problems import conflict, not_found
from service.platform.http.router import Router
from service.platform.settings import Settings
from service.platform.storage.quota import take
from service.recordings.actions import delete_recording, require_same_sensors
from service.recordings.queries import reading_document, summaries, view
from service.recordings.upload_actions import how_to_upload

router = Router(tags=["recordings"])


@router.post("/vehicles/{id}/recordings", status_code=201, response_model=CreatedRecording)
def post_recording(id: UUID, body: NewRecording, request: Request, access: WriteAccess) -> JSONResponse:
    """Announce a recording; its file follows in parts."""
    settings: Settings = request.app.state.settings
    vehicle = access.find(Vehicle, id, "engineer")
    if body.rig_id is None:
        rig = empty_rig(access.session, vehicle, body.name)
    else:
        rig = access.session.get(Rig, body.rig_id)
    if rig is None or rig.vehicle_id != vehicle.id:
        raise not_found()
    row = Recording(
        id=new_id(),
        fleet_id=vehicle.fleet_id,
        vehicle_id=id,
        rig_id=rig.id,
        name=body.name,
        file_name=body.file_name,
        marks_per_vertex=body.marks_per_vertex,
        reading=reading_document(access.session, rig.id, body.reading),
        retain_until=now(timedelta(days=body.retain_days).total_seconds()) if body.retain_days else None,
        created_by=access.person.id,
        expires_at=access.session.scalar(select(now(3600 * settings.upload_hours))),
    )
    access.session.add(row)
    access.session.flush()
    # One byte at least, so that a fleet without any room is told before the first part.
    take(access.session, row, body.size or 1, settings.fleet_quota_bytes)
    hint(access.session, row.fleet_id, "recording", row.id)
    document = view(access.session, row).model_dump()
    return access.answer(CreatedRecording(**document, upload=how_to_upload(request, row)))


@router.get("/recordings")
def get_recordings(
    access: ReadAccess,
    paging: Paging,
    fleet_id: UUID | None = None,
    vehicle_id: UUID | None = None,
    state: Annotated[RecordingState | None, Query()] = None,
) -> Page[RecordingSummary]:
    """The recordings of the person's fleets, newest first."""
    statement = select(Recording)
    for column, value in ((Recording.vehicle_id, vehicle_id), (Recording.state, state)):
        if value is not None:
            statement = statement.where(column == value)
    scopes = access.scopes(Recording, fleet_id)
    rows, following = fetch(access.session, statement, Recording.id, paging, newest_first=True, any_of=scopes)
    return Page(items=summaries(access.session, rows), next=following)


@router.get("/recordings/{id}")
def get_recording(id: UUID, access: ReadAccess, conditions: Conditional) -> RecordingView:
    """One recording with its sensors, its job, and its problem where it failed."""
    row = access.find(Recording, id)
    conditions.offer(version_etag(row.version), more_changes=True)
    return view(access.session, row)


@router.patch("/recordings/{id}")
def patch_recording(id: UUID, body: RecordingEdit, access: WriteAccess, conditions: Conditional) -> RecordingView:
    """Rename a recording, ask for more marks of each vertex, replace its rig; before it is ready, its reading."""
    row = access.find(Recording, id, "engineer", lock=True)
    conditions.edit(row)
    if body.rig_id and body.rig_id != row.rig_id:
        rig = access.session.get(Rig, body.rig_id)
        if rig is None or rig.vehicle_id != row.vehicle_id:
            raise not_found()
        if row.state == RecordingState.READY:
            require_same_sensors(access.session, row, rig)
        else:
            _refuse_if_read(row, "rig_in_use", "rig")
        row.rig_id = rig.id
    if body.reading is not None:
        _refuse_if_read(row, "reading_in_use", "reading")
        row.reading = reading_document(access.session, row.rig_id, body.reading)
    for name, value in body.model_dump(exclude_none=True, exclude={"rig_id", "reading"}).items():
        setattr(row, name, value)
    access.session.flush()
    hint(access.session, row.fleet_id, "recording", row.id)
    return view(access.session, row)


def _refuse_if_read(row: Recording, code: str, what: str) -> None:
    if row.state not in (RecordingState.UPLOADING, RecordingState.FAILED):
        raise conflict(
            code,
            f"The recording is {row.state}, read with the {what} that it has.",
            f"Upload it again with the other {what}.",
        )


@router.delete("/recordings/{id}", status_code=204)
def remove_recording(id: UUID, access: WriteAccess, with_published: bool = False) -> None:
    """Delete a recording with all that came from it: marks, detections, correspondences, calibrations."""
    row = access.find(Recording, id, "engineer")
    fleet_id = row.fleet_id
    access.session.expunge(row)
    delete_recording(access.session, id, with_published=with_published)
    hint(access.session, fleet_id, "recording", id)
