"""Routes of uploads: put numbered parts, see which have arrived, complete."""

from __future__ import annotations

from functools import partial
from typing import Annotated
from uuid import UUID

from fastapi import Path, Request
from fastapi.responses import JSONResponse

from apexcal.documents.recordings import MAX_PARTS, AcceptedRecording, Completion, Parts, PartView
from apexcal.documents.states import RecordingState
from service.platform.auth.access import Access, CurrentIdentity, ReadAccess, WriteAccess
from service.platform.db.base import Json
from service.platform.db.recordings import Recording, UploadPart
from service.platform.db.session import Database
from service.platform.http.limits import declared_length
from service.platform.http.problems import conflict
from service.platform.http.router import Router, header
from service.platform.job_status.views import job_views
from service.platform.settings import Settings
from service.platform.storage.disk_reservations import DiskReservations
from service.platform.storage.errors import StoreFullError
from service.platform.storage.store import Store
from service.recordings.jobs import queue_ingestion
from service.recordings.queries import parts_of, view
from service.recordings.upload_actions import (
    FORGET_S,
    Announced,
    Body,
    begin_part,
    check_complete,
    declared_sha256,
    finish_part,
    forget_part,
    how_to_upload,
    part_too_large,
    refuse_expired,
)

router = Router(tags=["recordings"])

# Settings say less; this only keeps the application's limit on JSON bodies away from parts.
_NO_PART_IS_LARGER = 5 * 1024**3
_SENT: Json = {
    "parameters": [header("Content-Digest", "sha-256=:<base64 of the 32 bytes>: (RFC 9530).", required=True)],
    "requestBody": {"required": True, "content": {"application/octet-stream": {"schema": {}}}},
}


@router.put("/recordings/{id}/parts/{number}", max_body_size=_NO_PART_IS_LARGER, openapi_extra=_SENT)
async def put_part(
    id: UUID, number: Annotated[int, Path(ge=1, le=MAX_PARTS)], request: Request, identity: CurrentIdentity
) -> PartView:
    """Store one part of the file, streamed. Content-Digest names its SHA-256; the same part may be sent again."""
    settings: Settings = request.app.state.settings
    database: Database = request.app.state.database
    writing = partial(request.app.state.threads.writing.run, caller=identity.person.id)
    length = declared_length(request)
    announced = Announced(id, number, declared_sha256(request), settings.max_part_bytes if length is None else length)
    if announced.size > settings.max_part_bytes:
        raise part_too_large(settings.max_part_bytes)
    begun = await writing(begin_part, database, identity, announced, settings)
    body = Body(request, settings.max_part_bytes)
    if isinstance(begun, UploadPart):
        # The bytes are looked at all the same: an answer of 200 says that they are the acknowledged ones.
        async for _ in body:
            pass
        body.check(announced)
        return PartView.model_validate(begun)
    try:
        await _store(request.app.state.disk, request.app.state.store, begun, body, announced.size)
        body.check(announced)
        part = await writing(finish_part, database, identity, announced, settings, begun, body.size)
    except Exception:
        await writing(forget_part, database, begun, wait_s=FORGET_S)
        raise
    return PartView.model_validate(part)


@router.get("/recordings/{id}/parts")
def get_parts(id: UUID, request: Request, access: ReadAccess) -> Parts:
    """Which parts have arrived and how the others go, so that an interrupted upload goes on where it stopped."""
    row = access.find(Recording, id, "engineer")
    refuse_expired(row)
    items = [PartView.model_validate(part) for part in parts_of(access.session, row)]
    return Parts(items=items, upload=how_to_upload(request, row))


@router.post("/recordings/{id}/complete", status_code=202, response_model=AcceptedRecording)
def complete(id: UUID, body: Completion, access: WriteAccess) -> JSONResponse:
    """Declare that all parts are there; ingestion starts. Saying it again gives the same answer."""
    row = access.find(Recording, id, "engineer", lock=True)
    refuse_expired(row)
    if check_complete(row, parts_of(access.session, row), body):
        row.size, row.sha256 = body.size, body.sha256
        row.taken_bytes = body.size
        queue_ingestion(access.session, row)
    return _accepted(access, row)


@router.post("/recordings/{id}/retry", status_code=202, response_model=AcceptedRecording)
def retry(id: UUID, access: WriteAccess) -> JSONResponse:
    """Ingest a failed recording again from its original, which is kept."""
    row = access.find(Recording, id, "engineer", lock=True)
    refuse_expired(row)
    if row.state != RecordingState.FAILED:
        raise conflict(
            "not_failed", f"Only a failed recording is ingested again; this one is {row.state}.", "Follow its job."
        )
    queue_ingestion(access.session, row)
    return _accepted(access, row)


def _accepted(access: Access, row: Recording) -> JSONResponse:
    """A recording on its way."""
    access.session.flush()
    recording = view(access.session, row)
    job = job_views(access.session, [row.job_id])[row.job_id or 0]
    return access.answer(AcceptedRecording(recording=recording, job=job), 202)


async def _store(disk: DiskReservations, store: Store, key: str, body: Body, size: int) -> None:
    """Raises :class:`StoreFullError` before or while the bytes are written."""
    async with disk.reserve(size) as reservation:
        await store.put_stream(key, reservation.watch(body))
        if reservation.lost is not None:
            raise StoreFullError(reservation.lost)
