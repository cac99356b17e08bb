"""Routes of camera frames: a frame is a byte range of its sensor's blob, and nothing is parsed to answer it."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Depends, Path, Query, Request, Response
from sqlalchemy import select

from apexcal.documents.base import Sought
from apexcal.documents.recordings import BlobAddress, FrameView
from service.platform.auth.access import CurrentIdentity, ReadAccess, brief_access
from service.platform.db.recordings import CameraFrame, Recording
from service.platform.http.etags import Conditional
from service.platform.http.pages import LongPaging, Page, fetch
from service.platform.http.problems import not_found
from service.platform.http.router import Router
from service.recordings.addresses import IN_PIECES, ByteRange
from service.recordings.queries import find_camera

router = Router(tags=["recordings"])

_SHOWN = frozenset(("image/jpeg", "image/png", "image/webp"))


@router.get("/recordings/{id}/cameras/{camera}/frames")
def get_frames(
    id: UUID,
    camera: Sought,
    access: ReadAccess,
    paging: LongPaging,
    from_ns: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
    to_ns: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
) -> Page[FrameView]:
    """A camera's frames in time order, up to 5000 a page; those from ``from_ns`` to ``to_ns``, both included."""
    sensor = find_camera(access.session, access.find(Recording, id).id, camera)
    statement = select(CameraFrame).where(CameraFrame.sensor_id == sensor.id)
    if from_ns is not None:
        statement = statement.where(CameraFrame.stamp_ns >= from_ns)
    if to_ns is not None:
        statement = statement.where(CameraFrame.stamp_ns <= to_ns)
    rows, following = fetch(access.session, statement, CameraFrame.index, paging)
    return Page(items=[FrameView.model_validate(row) for row in rows], next=following)


def _find(
    id: UUID, camera: Sought, index: Annotated[int, Path(ge=0, lt=2**31)], request: Request, identity: CurrentIdentity
) -> ByteRange:
    with brief_access(request, identity) as access:
        sensor = find_camera(access.session, access.find(Recording, id).id, camera)
        frame = access.session.get(CameraFrame, (sensor.id, index))
        if frame is None:
            raise not_found(
                "no_such_frame", f"{camera} has no frame {index}.", f"It has {sensor.count}, numbered from 0."
            )
        media_type = frame.media_type if frame.media_type in _SHOWN else "application/octet-stream"
        return ByteRange(sensor.blob_key, index, frame.offset, frame.length, media_type)


FrameRange = Annotated[ByteRange, Depends(_find)]


@router.get(
    "/recordings/{id}/cameras/{camera}/frames/{index}",
    dependencies=[IN_PIECES],
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}, "image/png": {}, "image/webp": {}}}},
)
async def get_frame(frame: FrameRange, request: Request, conditions: Conditional) -> Response:
    """One frame's image, as the camera or the ingestion encoded it."""
    return await frame.answer(request, conditions)


@router.get("/recordings/{id}/cameras/{camera}/frames/{index}/address")
def get_frame_address(frame: FrameRange, request: Request) -> BlobAddress:
    """Where the frame's bytes are read straight from the store, with a Range header; or that they are read here."""
    return frame.address(request)
