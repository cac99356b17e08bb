"""Overlays: a frame with the LiDAR's points, drawn by a worker through a result's lens, and read as a PNG."""

from __future__ import annotations

from typing import Annotated, NamedTuple
from uuid import UUID

from fastapi import Depends, Request, Response
from fastapi.responses import JSONResponse

from apexcal.documents.overlays import OverlayRequest, OverlayView
from service.annotations.disclosure_actions import tell_pairs
from service.platform.auth.access import Access, CurrentIdentity, ReadAccess, WriteAccess
from service.platform.db.calibrations import Result
from service.platform.db.session import Database
from service.platform.db.studies import StudyFile
from service.platform.http.etags import Conditional, content_etag
from service.platform.http.pages import Page, Paging
from service.platform.http.router import Router
from service.platform.storage.store import Store
from service.studies.overlay_plan import pairs_of, plan_overlay
from service.studies.queries import delete_study, disposition, list_studies, new_study, read_study, study_file
from service.studies.views import overlay_view

router = Router(tags=["studies"])
_KIND = "overlay"


@router.post("/results/{result_id}/overlays", status_code=202, response_model=OverlayView)
def ask_overlay(result_id: UUID, wanted: OverlayRequest, access: WriteAccess) -> JSONResponse:
    """Draw the sweep nearest to a frame into it, through the result's own lens, coloured by depth. [reviewer]

    Points behind the camera, past the lens's valid radius or hidden by nearer ones are left out. Points of the board
    and its holder are moved to the frame's time where the track is known. The image counts towards the fleet's quota
    until it is deleted.
    """
    result = access.find(Result, result_id, "reviewer")
    recording, plan = plan_overlay(access, result, wanted)
    row, job = new_study(access, recording, _KIND, plan)
    return access.answer(overlay_view(row, job), 202)


@router.get("/recordings/{recording_id}/overlays")
def list_overlays(recording_id: UUID, access: ReadAccess, window: Paging) -> Page[OverlayView]:
    """The overlays of a recording's frames, newest first."""
    return list_studies(access, recording_id, _KIND, window, overlay_view)


@router.get("/overlays/{overlay_id}")
def read_overlay(overlay_id: UUID, access: ReadAccess) -> OverlayView:
    """An overlay, and what is drawn in it."""
    return overlay_view(*read_study(access, overlay_id, _KIND))


@router.delete("/overlays/{overlay_id}", status_code=204)
def delete_overlay(overlay_id: UUID, access: WriteAccess) -> Response:
    """Delete an overlay and its image, or end its making. [reviewer]"""
    return delete_study(access, overlay_id, _KIND, "reviewer")


class _Kept(NamedTuple):
    """An image and its digest, looked up in a session that has ended."""

    made: StudyFile
    size: int
    sha256: str


def _find(overlay_id: UUID, request: Request, identity: CurrentIdentity) -> _Kept:
    database: Database = request.app.state.database
    with database.reading() as session:
        access = Access(session, identity)
        row, made, size = study_file(access, overlay_id, _KIND, "reviewer", "overlay")
        kept = _Kept(made, size, (row.result or {})["sha256"])
        result = session.get(Result, UUID(row.asked["result_id"]))
        if result is not None:
            tell_pairs(access, database, pairs_of(access, result), "result")
    return kept


@router.get(
    "/overlays/{overlay_id}/image",
    response_class=Response,
    responses={200: {"content": {"image/png": {"schema": {"type": "string", "format": "binary"}}}}},
)
async def get_overlay_image(
    kept: Annotated[_Kept, Depends(_find)], request: Request, conditions: Conditional
) -> Response:
    """The overlay's image, a PNG. [reviewer]

    It shows where a fit puts the vertices, so what one answers afterwards on those that were marked for the result
    counts as reviewed.
    """
    etag = content_etag(kept.sha256)
    conditions.offer(etag)
    store: Store = request.app.state.store
    data = await store.read(kept.made.blob_key, 0, kept.size)
    headers = {"ETag": etag, "Content-Disposition": disposition(kept.made, "inline")}
    return Response(data, media_type="image/png", headers=headers)
