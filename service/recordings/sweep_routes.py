"""Routes of the LiDAR's sweeps, packed by a worker: a sweep is a byte range of its sensor's packed file."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Depends, Path, Query, Request, Response
from sqlalchemy import select

from apexcal.documents.recordings import BlobAddress
from apexcal.documents.sweeps import MEDIA_TYPE, SweepView
from service.platform.auth.access import Access, CurrentIdentity, ReadAccess, brief_access
from service.platform.db.recordings import PackedSweep, PackedSweeps, Recording, Sensor
from service.platform.http.etags import Conditional
from service.platform.http.pages import LongPaging, Page, fetch
from service.platform.http.problems import conflict, not_found
from service.platform.http.router import Router
from service.recordings.addresses import IN_PIECES, ByteRange
from service.recordings.queries import require_ready

router = Router(tags=["recordings"])


@router.get("/recordings/{id}/sweeps")
def get_sweeps(
    id: UUID,
    access: ReadAccess,
    paging: LongPaging,
    from_ns: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
    to_ns: Annotated[int | None, Query(ge=0, lt=2**63)] = None,
) -> Page[SweepView]:
    """The LiDAR's sweeps in time order, up to 5000 a page; those from ``from_ns`` to ``to_ns``, both included."""
    packed = _packed(access, access.find(Recording, id))
    statement = select(PackedSweep).where(PackedSweep.sensor_id == packed.sensor_id)
    if from_ns is not None:
        statement = statement.where(PackedSweep.stamp_ns >= from_ns)
    if to_ns is not None:
        statement = statement.where(PackedSweep.stamp_ns <= to_ns)
    rows, following = fetch(access.session, statement, PackedSweep.index, paging)
    return Page(items=[SweepView.model_validate(row) for row in rows], next=following)


def _packed(access: Access, recording: Recording) -> PackedSweeps:
    """The packed file of a recording's LiDAR. Raises :class:`Problem` 409 ``recording_not_ready``, ``not_packed``."""
    statement = select(PackedSweeps).join(Sensor, Sensor.id == PackedSweeps.sensor_id)
    packed = access.session.scalars(statement.where(Sensor.recording_id == recording.id)).one_or_none()
    if packed is not None:
        return packed
    require_ready(recording)
    raise conflict(
        "not_packed",
        f"The sweeps of {recording.name!r} are not packed: only packed sweeps are sent.",
        "A recording is packed right after it was read: wait for its job. Where that failed, ask again: POST "
        "/v1/analyses with the kind packing.",
    )


def _find(
    id: UUID, index: Annotated[int, Path(ge=0, lt=2**31)], request: Request, identity: CurrentIdentity
) -> ByteRange:
    with brief_access(request, identity) as access:
        packed = _packed(access, access.find(Recording, id))
        sweep = access.session.get(PackedSweep, (packed.sensor_id, index))
        if sweep is None:
            raise not_found(
                "no_such_sweep", f"The recording has no sweep {index}.", "Its sweeps are numbered from 0."
            )
        return ByteRange(packed.blob_key, index, sweep.offset, sweep.length, MEDIA_TYPE)


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
