"""Routes of camera frames: a frame is a byte range of its sensor's blob, and nothing is parsed to answer it."""

from __future__ import annotations

import hashlib
from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Path, Query, Request, Response
from sqlalchemy import select

from service.auth.access import ReadAccess
from service.db.recordings import CameraFrame, Recording
from service.http.etags import Conditional, content_etag
from service.http.pages import LongPaging, Page, fetch
from service.http.problems import Problem
from service.recordings.queries import find_camera
from service.recordings.schemas import FrameView
from service.storage.store import Store

router = APIRouter(tags=["recordings"])

_FOREVER = "private, max-age=31536000, immutable"
_SHOWN = frozenset(("image/jpeg", "image/png", "image/webp"))


@router.get("/recordings/{id}/cameras/{camera}/frames")
def get_frames(
    id: UUID,
    camera: str,
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


@router.get(
    "/recordings/{id}/cameras/{camera}/frames/{index}",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}, "image/png": {}, "image/webp": {}}}},
)
def get_frame(
    id: UUID,
    camera: str,
    index: Annotated[int, Path(ge=0, lt=2**31)],
    request: Request,
    access: ReadAccess,
    conditions: Conditional,
) -> Response:
    """One frame's image, as the camera or the ingestion encoded it."""
    sensor = find_camera(access, access.find(Recording, id), camera)
    frame = access.session.get(CameraFrame, (sensor.id, index))
    if frame is None:
        raise Problem(
            404, "no_such_frame", f"{camera} has no frame {index}.", f"It has {sensor.count}, numbered from 0."
        )
    etag = content_etag(hashlib.sha256(f"{sensor.blob_key}:{index}".encode()).hexdigest()[:32])
    conditions.offer(etag)
    store: Store = request.app.state.store
    data = store.get_range(sensor.blob_key, frame.offset, frame.length)
    media_type = frame.media_type if frame.media_type in _SHOWN else "application/octet-stream"
    return Response(data, media_type=media_type, headers={"ETag": etag, "Cache-Control": _FOREVER})
