"""Routes of camera frames: a frame is a byte range of its sensor's blob, and nothing is parsed to answer it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from sqlalchemy import select

from apexcal.documents.base import Sought
from apexcal.documents.recordings import BlobAddress, FrameView
from service.auth.access import Access, CurrentIdentity, ReadAccess
from service.db.recordings import CameraFrame, Recording
from service.db.session import Database
from service.http.etags import Conditional, content_etag
from service.http.pages import LongPaging, Page, fetch
from service.http.problems import Problem
from service.recordings.presigner import Presigner
from service.recordings.queries import find_camera
from service.storage.store import Store

router = APIRouter(tags=["recordings"])

_FOREVER = "private, max-age=31536000, immutable"
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
    sensor = find_camera(access, access.find(Recording, id), camera)
    statement = select(CameraFrame).where(CameraFrame.sensor_id == sensor.id)
    if from_ns is not None:
        statement = statement.where(CameraFrame.stamp_ns >= from_ns)
    if to_ns is not None:
        statement = statement.where(CameraFrame.stamp_ns <= to_ns)
    rows, following = fetch(access.session, statement, CameraFrame.index, paging)
    return Page(items=[FrameView.model_validate(row) for row in rows], next=following)


@dataclass(frozen=True)
class _Found:
    """A frame's byte range, looked up in a session that has ended: none is held while the store is asked."""

    key: str
    index: int
    offset: int
    length: int
    media_type: str

    @property
    def etag(self) -> str:
        return content_etag(hashlib.sha256(f"{self.key}:{self.index}".encode()).hexdigest()[:32])


def _find(
    id: UUID,
    camera: Sought,
    index: Annotated[int, Path(ge=0, lt=2**31)],
    request: Request,
    identity: CurrentIdentity,
) -> _Found:
    database: Database = request.app.state.database
    with database.reading() as session:
        access = Access(session, identity)
        sensor = find_camera(access, access.find(Recording, id), camera)
        frame = session.get(CameraFrame, (sensor.id, index))
        if frame is None:
            raise Problem(
                404, "no_such_frame", f"{camera} has no frame {index}.", f"It has {sensor.count}, numbered from 0."
            )
        media_type = frame.media_type if frame.media_type in _SHOWN else "application/octet-stream"
        return _Found(sensor.blob_key, index, frame.offset, frame.length, media_type)


Found = Annotated[_Found, Depends(_find)]


@router.get(
    "/recordings/{id}/cameras/{camera}/frames/{index}",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}, "image/png": {}, "image/webp": {}}}},
)
async def get_frame(frame: Found, request: Request, conditions: Conditional) -> Response:
    """One frame's image, as the camera or the ingestion encoded it."""
    conditions.offer(frame.etag)
    store: Store = request.app.state.store
    data = await store.read(frame.key, frame.offset, frame.length)
    headers = {"ETag": frame.etag, "Cache-Control": _FOREVER}
    return Response(data, media_type=frame.media_type, headers=headers)


@router.get("/recordings/{id}/cameras/{camera}/frames/{index}/address")
def get_frame_address(frame: Found, request: Request) -> BlobAddress:
    """Where the frame's bytes are read straight from the store, with a Range header; or that they are read here.

    An address and no redirect: the frame is a range of a large object, and only who sends the Range gets it alone.
    """
    presigner = Presigner.of(request)
    return BlobAddress(
        url=presigner.download(frame.key),
        expires_at=presigner.expires_at if presigner.downloads else None,
        offset=frame.offset,
        length=frame.length,
        media_type=frame.media_type,
    )
