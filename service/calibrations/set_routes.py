"""Correspondence sets: made of marks, or imported."""

from __future__ import annotations

from typing import Annotated, NamedTuple
from uuid import UUID

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import JSONResponse

from service.annotations.disclosure import answered_by_others, keep, tell_pairs
from service.auth.access import CurrentIdentity, ReadAccess, WriteAccess
from service.auth.roles import rank
from service.calibrations.building import build
from service.calibrations.pairs import Columns, invalid, read_csv, read_json
from service.calibrations.schemas import BuildRequest, SetView, SetWithPairs
from service.calibrations.sets import keep_set, notes_on_image, rig_camera, set_view, set_with_pairs, summaries
from service.db.calibrations import CorrespondenceSet
from service.db.detections import Detection
from service.db.fleets import Rig
from service.db.recordings import Recording
from service.detections.queries import find_camera
from service.events.hints import hint
from service.http.etags import Conditional, content_etag
from service.http.pages import Page, Paging, fetch
from service.http.problems import Problem

router = APIRouter()

_IMPORTED = {
    "requestBody": {
        "required": True,
        "content": {
            "text/csv": {"schema": {"type": "string", "example": "x,y,z,u,v,group\n4.1,0.2,0.9,961.2,540.8,1\n"}},
            "application/json": {
                "schema": {
                    "type": "object",
                    "required": ["pairs"],
                    "properties": {"pairs": {"type": "array", "items": {"type": "object"}}},
                }
            },
        },
    }
}


@router.post("/detections/{detection_id}/correspondence-sets", status_code=201, response_model=SetView)
def build_set(detection_id: UUID, wanted: BuildRequest, access: WriteAccess) -> JSONResponse:
    """Make pairs of what people marked; the same content is found again, with 200, and is the newest. [engineer]"""
    detection = access.find(Detection, detection_id, "engineer")
    recording = access.find(Recording, detection.recording_id, "engineer")
    camera = find_camera(access.session, recording.id, wanted.camera)
    built = build(access.session, detection, camera, exclude_flagged=wanted.exclude_flagged)
    # Its notes say what people answered.
    others = answered_by_others(access.session, detection.id, camera.id, access.person.id)
    keep(access.session, access.person.id, camera, others, "pairs")
    row = CorrespondenceSet(
        fleet_id=recording.fleet_id,
        vehicle_id=recording.vehicle_id,
        rig_id=recording.rig_id,
        recording_id=recording.id,
        detection_id=detection.id,
        camera=camera.name,
        source="annotations",
        pairs=built.columns,
        notes=built.notes,
        created_by=access.person.id,
    )
    return _keep(access, row)


class _Raw(NamedTuple):
    media_type: str
    body: bytes


async def _raw(request: Request) -> _Raw:
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    return _Raw(media_type, await request.body())


def _imported(identity: CurrentIdentity, raw: Annotated[_Raw, Depends(_raw)]) -> Columns:
    """The pairs in the body of somebody who is signed in, read before any transaction begins."""
    if raw.media_type == "application/json":
        return read_json(raw.body)
    if raw.media_type == "text/csv":
        try:
            return read_csv(raw.body.decode("utf-8"))
        except UnicodeDecodeError as error:
            raise invalid(f"The file is no UTF-8 text: byte {error.start}.") from None
    raise Problem(
        415,
        "unsupported_media_type",
        f"Pairs come as text/csv or application/json, not as {raw.media_type or 'an unnamed type'}.",
        "Name the type in Content-Type.",
    )


@router.post("/rigs/{rig_id}/correspondence-sets", status_code=201, response_model=SetView, openapi_extra=_IMPORTED)
def import_set(
    rig_id: UUID,
    camera: Annotated[str, Query(max_length=200)],
    columns: Annotated[Columns, Depends(_imported)],
    access: WriteAccess,
) -> JSONResponse:
    """Import pairs, as CSV or JSON; the same content is found again, with 200, and is the newest again. [engineer]"""
    rig = access.find(Rig, rig_id, "engineer")
    of = rig_camera(access.session, rig, camera)
    row = CorrespondenceSet(
        fleet_id=rig.fleet_id,
        vehicle_id=rig.vehicle_id,
        rig_id=rig.id,
        camera=of.name,
        source="import",
        pairs=columns,
        notes=notes_on_image(columns, of),
        created_by=access.person.id,
    )
    return _keep(access, row)


def _keep(access: WriteAccess, wanted: CorrespondenceSet) -> JSONResponse:
    row, is_new = keep_set(access.session, wanted)
    if is_new:
        hint(access.session, row.fleet_id, "detection" if row.detection_id else "rig", row.detection_id or row.rig_id)
    return access.answer(set_view(row, row.pairs.get("flagged")), 201 if is_new else 200)


@router.get("/correspondence-sets/{set_id}")
def read_set(set_id: UUID, access: ReadAccess, conditions: Conditional, request: Request) -> SetWithPairs:
    """A correspondence set with its pairs, in the form in which they are imported. [reviewer, if made of marks]

    What one answers afterwards on the vertices of such a set counts as reviewed.
    """
    row = access.find(CorrespondenceSet, set_id)
    if row.source == "annotations":
        access.need(row.fleet_id, "reviewer")
    conditions.offer(content_etag(row.content_hash))
    found = set_with_pairs(row)
    tell_pairs(access, request.app.state.database, row, "pairs")
    return found


@router.get("/rigs/{rig_id}/correspondence-sets")
def list_sets(rig_id: UUID, access: ReadAccess, window: Paging) -> Page[SetView]:
    """A rig's correspondence sets, the last made first, without their pairs; those made of marks for reviewers."""
    rig = access.find(Rig, rig_id)
    statement = summaries().where(CorrespondenceSet.rig_id == rig.id)
    if rank(access.role(rig.fleet_id) or "") < rank("reviewer"):
        # Their counts and notes say what people answered.
        statement = statement.where(CorrespondenceSet.source == "import")
    rows, following = fetch(access.session, statement, CorrespondenceSet.id, window, newest_first=True)
    return Page(items=[set_view(row, flagged) for row, flagged in rows], next=following)
