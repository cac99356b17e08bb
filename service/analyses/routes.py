"""Analyses: each is asked for with POST, and read until its state is done or failed."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Body, Depends, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse

from apexcal.documents.analysis_kinds import AnalysisKind, AnalysisPage, AnalysisRequest, AnyAnalysis
from apexcal.documents.machine_marks import MarksList
from service.analyses.actions import delete_analysis
from service.analyses.jobs import queue_analysis
from service.analyses.kinds import plan_of, view_of
from service.analyses.machine_marks import list_marks
from service.analyses.queries import AnalysisDownload, analysis_file, job_of, list_analyses, shown_pairs
from service.annotations.disclosure_actions import disclose_pairs
from service.platform.auth.access import CurrentIdentity, ReadAccess, WriteAccess, brief_access
from service.platform.db.analyses import Analysis
from service.platform.http.etags import Conditional, content_etag
from service.platform.http.pages import Paging
from service.platform.http.router import DOCUMENT, Router
from service.platform.http.store_problems import streamed
from service.platform.storage.store import Store
from service.recordings.addresses import IN_PIECES

router = Router(tags=["analyses"])

# A report holds its own styles, script, pictures and data, and needs nothing else. In a sandbox without an origin it
# reaches neither cookies nor the API, whatever stands in it.
_PAGE_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts allow-downloads allow-popups "
    "allow-popups-to-escape-sandbox"
)


@router.post("/analyses", status_code=202, response_model=AnyAnalysis, max_body_size=DOCUMENT)
def ask(request: Annotated[AnalysisRequest, Body()], access: WriteAccess) -> JSONResponse:
    """Ask something that a worker answers. [engineer; reviewer for a report]

    `preview` counts what a region keeps. `suggestion` computes a region from what moves against the still background.
    `clock_offset` estimates from vertices and their marks how far the camera's clock is ahead of the LiDAR's.
    `machine_marks` has the machine mark a detection's vertices in a camera; each detection asks for that by itself.
    `precision` fits a camera's marks of now; the service asks for that by itself at every few dozen marks more.
    `calibrated_copy` copies the recording's own bag with CameraInfo and `/tf_static` as published; every other
    message stays, byte for byte. With `for_viewers` it is an MCAP file for Foxglove and Lichtblick, of any recording,
    with undistorted frames beside the recorded ones.
    `pixel_points` answers which points in 3D pixels of a camera show, with their covariances.
    `report` saves what is known of a result as one HTML file. `remedies` tries what its checks advise, and says what
    each would bring on held-out pairs. `pair_validation`, `lane_validation` and
    `edge_validation` test a calibration on pairs that it was not fitted to, or on a drive. Files count towards the
    fleet's quota until they are deleted.
    """
    row = plan_of(access, request)
    return access.answer(view_of(row, queue_analysis(access.session, row)), 202)


@router.get("/analyses")
def list_of_fleets(
    access: ReadAccess,
    window: Paging,
    fleet_id: UUID | None = None,
    vehicle_id: UUID | None = None,
    recording_id: UUID | None = None,
    result_id: UUID | None = None,
    kind: Annotated[list[AnalysisKind] | None, Query(description="only analyses of these kinds")] = None,
) -> AnalysisPage:
    """The analyses of the person's fleets, newest first, without single pairs."""
    of = {"vehicle_id": vehicle_id, "recording_id": recording_id, "result_id": result_id}
    return list_analyses(access, fleet_id, of, kind or [], window)


@router.get("/analyses/{analysis_id}", response_model=AnyAnalysis)
def read(analysis_id: UUID, access: ReadAccess, request: Request) -> AnyAnalysis:
    """An analysis: `result` is there when it is done, `problem` when it failed.

    If pairs were made of marks, only reviewers see single pairs. Their later answers on these vertices count as
    reviewed.
    """
    row = access.find(Analysis, analysis_id)
    pairs = shown_pairs(access, row) if row.kind == "pair_validation" else None
    view = view_of(row, job_of(access.session, row), with_pairs=pairs is not None)
    if pairs is not None:
        disclose_pairs(access, request.app.state.database, pairs, "result")
    return view


@router.delete("/analyses/{analysis_id}", status_code=204)
def delete(analysis_id: UUID, access: WriteAccess) -> Response:
    """Delete an analysis with its file, or end its making. [engineer; reviewer for a report]"""
    delete_analysis(access, analysis_id)
    return Response(status_code=204)


@router.get("/analyses/{analysis_id}/marks", operation_id="analyses.list_marks")
def get_marks(request: Request, analysis_id: UUID, access: ReadAccess) -> MarksList:
    """The machine's marks. [reviewer] Later answers of the reader on these vertices count as reviewed."""
    return list_marks(access, request.app.state.database, analysis_id)


def _file(analysis_id: UUID, request: Request, identity: CurrentIdentity) -> AnalysisDownload:
    """Find the file. The session ends with this dependency, before any byte is read."""
    with brief_access(request, identity) as access:
        return analysis_file(access, request.app.state.database, analysis_id)


@router.get("/analyses/{analysis_id}/file", dependencies=[IN_PIECES], response_class=StreamingResponse)
async def get_file(
    request: Request,
    file: Annotated[AnalysisDownload, Depends(_file)],
    conditions: Conditional,
    download: Annotated[bool, Query(description="a report too as a file to save")] = False,
) -> Response:
    """The file of a calibrated copy [engineer] or of a report [reviewer, if its pairs are made of marks].

    A report is one HTML file that needs nothing else. It shows single pairs, so the reader's later answers on their
    vertices count as reviewed.
    """
    etag = content_etag(file.key.rpartition("/")[2].partition(".")[0])
    conditions.offer(etag)
    store: Store = request.app.state.store
    headers = {"ETag": etag, "Content-Length": str(file.size)}
    headers["Content-Disposition"] = file.disposition(save=download or not file.is_page)
    if file.is_page:
        headers["Content-Security-Policy"] = _PAGE_POLICY
    media_type = "text/html" if file.is_page else "application/octet-stream"
    return await streamed(store.read_all(file.key), media_type, headers)
