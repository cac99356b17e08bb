"""Analyses of a recording: each is asked for with POST, and read until its state is done or failed."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated
from uuid import UUID

from fastapi import Body, Depends, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from apexcal.documents.analysis_kinds import AnalysisKind, AnalysisPage, AnalysisRequest, AnyAnalysis
from apexcal.documents.machine_marks import MarksList
from service.analyses.actions import ask_analysis, delete_analysis
from service.analyses.kinds import view_of
from service.analyses.machine_marks import list_marks
from service.analyses.queries import AnalysisDownload, analysis_file, job_of, list_analyses
from service.detections.queries import ready_recording
from service.platform.auth.access import Access, CurrentIdentity, ReadAccess, WriteAccess
from service.platform.db.analyses import Analysis
from service.platform.db.session import Database
from service.platform.http.bodies import DOCUMENT
from service.platform.http.pages import Paging
from service.platform.http.router import Router
from service.platform.storage.store import Store

router = Router(tags=["analyses"])


@router.post(
    "/recordings/{recording_id}/analyses", status_code=202, response_model=AnyAnalysis, max_body_size=DOCUMENT
)
def ask(recording_id: UUID, wanted: Annotated[AnalysisRequest, Body()], access: WriteAccess) -> JSONResponse:
    """Ask something of a recording that a worker answers. [engineer]

    `preview` counts what a region keeps. `suggestion` computes a region from what moves against the still background.
    `clock_offset` estimates from vertices and their marks how far the camera's clock is ahead of the LiDAR's.
    `machine_marks` has the machine mark a detection's vertices in a camera; each detection asks for that by itself.
    `packing` packs the sweeps, so that they can be read. `calibrated_copy` copies the recording's own bag with
    CameraInfo and `/tf_static` as published; every other message stays, byte for byte. With `for_viewers` it is an
    MCAP file for Foxglove and Lichtblick, of any recording, with undistorted frames beside the recorded ones. The
    copy counts towards the fleet's quota until it is deleted.
    """
    recording = ready_recording(access, recording_id, "engineer")
    return access.answer(view_of(*ask_analysis(access, recording, wanted)), 202)


@router.get("/recordings/{recording_id}/analyses")
def list_of_recording(
    recording_id: UUID,
    access: ReadAccess,
    window: Paging,
    kind: Annotated[AnalysisKind | None, Query(description="only analyses of this kind")] = None,
) -> AnalysisPage:
    """The analyses of a recording, newest first."""
    return list_analyses(access, recording_id, kind, window)


@router.get("/analyses/{analysis_id}", response_model=AnyAnalysis)
def read(analysis_id: UUID, access: ReadAccess) -> AnyAnalysis:
    """An analysis: `result` is there when it is done, `problem` when it failed."""
    row = access.find(Analysis, analysis_id)
    return view_of(row, job_of(access.session, row))


@router.delete("/analyses/{analysis_id}", status_code=204)
def delete(analysis_id: UUID, access: WriteAccess) -> Response:
    """Delete an analysis with its file, or end its making. [engineer]"""
    delete_analysis(access, analysis_id)
    return Response(status_code=204)


@router.get("/analyses/{analysis_id}/marks")
def get_marks(request: Request, analysis_id: UUID, access: ReadAccess) -> MarksList:
    """The machine's marks. [reviewer] What one answers on their vertices afterwards counts as reviewed."""
    return list_marks(access, request.app.state.database, analysis_id)


def _file(analysis_id: UUID, request: Request, identity: CurrentIdentity) -> AnalysisDownload:
    """The session ends here, before any byte is read."""
    database: Database = request.app.state.database
    with database.reading() as session:
        return analysis_file(Access(session, identity), analysis_id)


@router.get("/analyses/{analysis_id}/file", response_class=StreamingResponse)
async def get_file(request: Request, file: Annotated[AnalysisDownload, Depends(_file)]) -> Response:
    """The file of a calibrated copy. [engineer]"""
    store: Store = request.app.state.store
    pieces = aiter(store.read_all(file.key))
    # The first piece is fetched before the answer begins, so that a store that fails is answered with a problem.
    first = await anext(pieces, b"")
    return StreamingResponse(
        _after(first, pieces),
        media_type="application/octet-stream",
        headers={"Content-Length": str(file.size), "Content-Disposition": file.disposition},
    )


async def _after(first: bytes, rest: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    yield first
    async for piece in rest:
        yield piece
