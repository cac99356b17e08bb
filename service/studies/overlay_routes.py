"""Overlays: a frame with the LiDAR's points, drawn by a worker through a result's lens, and read as a PNG."""

from __future__ import annotations

from typing import Annotated, NamedTuple
from urllib.parse import quote
from uuid import UUID

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import JSONResponse

from apexcal.documents.overlays import OverlayRequest, OverlayView
from service.annotations.disclosure_actions import tell_pairs
from service.auth.access import Access, CurrentIdentity, ReadAccess, WriteAccess
from service.db.calibrations import Result
from service.db.recordings import Blob
from service.db.session import Database
from service.db.studies import StudyFile
from service.http.etags import Conditional, content_etag
from service.http.pages import Page, Paging
from service.http.problems import Problem
from service.storage.store import Store
from service.studies.overlay_plan import pairs_of, plan_overlay
from service.studies.queries import delete_study, list_studies, new_study, read_study
from service.studies.views import overlay_view

router = APIRouter(tags=["studies"])
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
    found, _ = read_study(access, overlay_id, _KIND)
    access.need(found.fleet_id, "reviewer")
    delete_study(access.session, found)
    return Response(status_code=204)


class _Kept(NamedTuple):
    """An image's place, looked up in a session that has ended."""

    key: str
    size: int
    sha256: str
    name: str


def _find(overlay_id: UUID, request: Request, identity: CurrentIdentity) -> _Kept:
    database: Database = request.app.state.database
    with database.reading() as session:
        access = Access(session, identity)
        row, _ = read_study(access, overlay_id, _KIND)
        access.need(row.fleet_id, "reviewer")
        made = session.get(StudyFile, row.id)
        if made is None:
            raise Problem(
                409,
                "overlay_not_ready",
                f"This overlay is {row.state}; it has no image.",
                "Wait until its state is done.",
                state=row.state,
            )
        size = session.get_one(Blob, made.blob_key).size
        kept = _Kept(made.blob_key, size, (row.result or {})["sha256"], made.file_name)
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
    data = await store.read(kept.key, 0, kept.size)
    disposition = f"inline; filename*=UTF-8''{quote(kept.name, safe='')}"
    return Response(data, media_type="image/png", headers={"ETag": etag, "Content-Disposition": disposition})
