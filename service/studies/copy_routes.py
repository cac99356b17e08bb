"""Copies of recordings with their calibration: asked for, followed, read as a file, deleted."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated
from uuid import UUID

from fastapi import Depends, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from apexcal.documents.copies import CopyRequest, CopyView
from service.detections.queries import ready_recording
from service.platform.auth.access import Access, CurrentIdentity, ReadAccess, WriteAccess
from service.platform.db.session import Database
from service.platform.db.studies import StudyFile
from service.platform.http.pages import Page, Paging
from service.platform.http.router import Router
from service.platform.storage.store import Store
from service.studies.queries import delete_study, disposition, list_studies, new_study, read_study, study_file
from service.studies.views import copy_view

router = Router(tags=["studies"])
_KIND = "calibrated_copy"


@router.post("/recordings/{recording_id}/calibrated-copies", status_code=202, response_model=CopyView)
def ask_copy(recording_id: UUID, wanted: CopyRequest, access: WriteAccess) -> JSONResponse:
    """Copy the recording's own bag with CameraInfo and `/tf_static` as published. [engineer]

    Every other message stays, byte for byte. ``for_viewers``: instead an MCAP file for Foxglove and Lichtblick, of
    any recording, with undistorted frames beside the recorded ones. The copy counts towards the fleet's quota until
    it is deleted.
    """
    # Imported here: it needs NumPy, which takes a twentieth of the start.
    from service.studies.copy_plan import plan_copy
    from service.studies.viewer_plan import plan_viewer_file

    recording = ready_recording(access, recording_id, "engineer")
    plan = (plan_viewer_file if wanted.for_viewers else plan_copy)(access.session, recording, wanted)
    row, job = new_study(access, recording, _KIND, plan)
    return access.answer(copy_view(row, job), 202)


@router.get("/recordings/{recording_id}/calibrated-copies")
def list_copies(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[CopyView]:
    """The copies of a recording, newest first."""
    return list_studies(access, recording_id, _KIND, window, copy_view)


@router.get("/calibrated-copies/{copy_id}")
def read_copy(copy_id: UUID, access: ReadAccess) -> CopyView:
    """A copy of a recording."""
    return copy_view(*read_study(access, copy_id, _KIND))


@router.delete("/calibrated-copies/{copy_id}", status_code=204)
def delete_copy(copy_id: UUID, access: WriteAccess) -> Response:
    """Delete a copy and its file, or end its making. [engineer]"""
    return delete_study(access, copy_id, _KIND, "engineer")


def _file(copy_id: UUID, request: Request, identity: CurrentIdentity) -> tuple[StudyFile, int]:
    """The copy's file and its size. The session ends here, before any byte is read."""
    database: Database = request.app.state.database
    with database.reading() as session:
        made, size = study_file(Access(session, identity), copy_id, _KIND, "engineer", "copy")
        return made, size


@router.get("/calibrated-copies/{copy_id}/file", response_class=StreamingResponse)
async def get_copy_file(request: Request, found: Annotated[tuple[StudyFile, int], Depends(_file)]) -> Response:
    """The copy's file. [engineer]"""
    made, size = found
    store: Store = request.app.state.store
    pieces = aiter(store.read_all(made.blob_key))
    # The first piece is fetched before the answer begins, so that a store that fails is answered with a problem.
    first = await anext(pieces, b"")
    return StreamingResponse(
        _after(first, pieces),
        media_type="application/octet-stream",
        headers={"Content-Length": str(size), "Content-Disposition": disposition(made)},
    )


async def _after(first: bytes, rest: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    yield first
    async for piece in rest:
        yield piece
