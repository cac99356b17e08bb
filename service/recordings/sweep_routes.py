"""Routes of the LiDAR's sweeps: a sweep is a byte range of its sensor's file, which has an index of them."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Depends, Path, Query, Request, Response
from sqlalchemy import select

from apexcal.documents.recordings import BlobAddress
from apexcal.documents.sensor_files import sweep_index_at
from apexcal.documents.sweeps import MEDIA_TYPE, SweepView
from service.platform.auth.access import CurrentIdentity, brief_access
from service.platform.db.recordings import Blob, Recording, Sensor
from service.platform.http.etags import Conditional
from service.platform.http.pages import LongPaging, Page, invalid_cursor
from service.platform.http.problems import not_found
from service.platform.http.router import Router
from service.platform.storage.errors import EXPIRED, MissingBlobError
from service.recordings.addresses import IN_PIECES, ByteRange
from service.recordings.queries import require_ready
from service.recordings.sweep_indexes import SweepIndexes, SweepsFile

router = Router(tags=["recordings"])


def _file_of(id: UUID, request: Request, identity: CurrentIdentity) -> SweepsFile:
    """Raises :class:`Problem` 409 ``recording_not_ready``, 410 ``retention_ended``."""
    with brief_access(request, identity) as access:
        recording = access.find(Recording, id)
        require_ready(recording)
        of_lidar = (Sensor.recording_id == recording.id, Sensor.kind == "lidar")
        columns = select(Sensor.blob_key, Sensor.count, Blob.size).join(Blob, Blob.key == Sensor.blob_key)
        key, count, size = access.session.execute(columns.where(*of_lidar)).one()
    if key == EXPIRED:
        raise MissingBlobError(key)
    return SweepsFile(key, sweep_index_at(size, count), count)


File = Annotated[SweepsFile, Depends(_file_of)]


@router.get("/recordings/{id}/sweeps")
async def get_sweeps(
    file: File,
    request: Request,
    paging: LongPaging,
    from_ns: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
    to_ns: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
) -> Page[SweepView]:
    """The LiDAR's sweeps in time order, up to 5000 a page; those from ``from_ns`` to ``to_ns``, both included."""
    indexes: SweepIndexes = request.app.state.sweep_indexes
    first = 0 if from_ns is None else await indexes.at_or_after(file, from_ns)
    stop = file.count if to_ns is None else await indexes.at_or_after(file, to_ns + 1)
    if paging.after is not None:
        if not paging.after.isdecimal() or len(paging.after) > 19:
            raise invalid_cursor(paging.after)
        first = max(first, int(paging.after) + 1)
    numbers = range(first, min(stop, first + paging.limit))
    entries = [(index, await indexes.entry(file, index)) for index in numbers]
    items = [SweepView(index=i, stamp_ns=at.stamp_ns, points=at.points, length=at.length) for i, at in entries]
    return Page(items=items, next=str(numbers[-1]) if numbers and numbers.stop < stop else None)


async def _find(file: File, index: Annotated[int, Path(ge=0, lt=2**31)], request: Request) -> ByteRange:
    if index >= file.count:
        raise not_found(
            "no_such_sweep", f"The recording has no sweep {index}.", f"It has {file.count}, numbered from 0."
        )
    indexes: SweepIndexes = request.app.state.sweep_indexes
    entry = await indexes.entry(file, index)
    return ByteRange(file.key, index, entry.offset, entry.length, MEDIA_TYPE)


SweepRange = Annotated[ByteRange, Depends(_find)]


@router.get(
    "/recordings/{id}/sweeps/{index}",
    dependencies=[IN_PIECES],
    response_class=Response,
    responses={200: {"content": {MEDIA_TYPE: {}}}},
)
async def get_sweep(sweep: SweepRange, request: Request, conditions: Conditional) -> Response:
    """One sweep's points, packed; docs/api.md has the layout."""
    return await sweep.answer(request, conditions)


@router.get("/recordings/{id}/sweeps/{index}/address")
def get_sweep_address(sweep: SweepRange, request: Request) -> BlobAddress:
    """Where the sweep's bytes are read straight from the store, with a Range header; or that they are read here."""
    return sweep.address(request)
