"""Routes for parts that go from the client into the store: ask for an address, put the part there, announce it.

An address takes as many bytes as were announced, whatever their checksum, and works until it expires. So the store
copies the part to a key that nobody has an address of. The copy's size is checked and the copy acknowledged. The
worker compares the checksum of every part before it reads the file. Some stores accept more bytes than announced:
then the size is checked first, and a larger part is removed.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated
from uuid import UUID

from fastapi import Path, Request

from apexcal.documents.recordings import MAX_PARTS, NewPart, PartAddress, PartView, PutPart
from service.platform.auth.access import Access, CurrentIdentity, Identity
from service.platform.db.recordings import Blob, Recording, UploadPart
from service.platform.db.session import Database
from service.platform.http.problems import Problem, conflict
from service.platform.http.router import Router
from service.platform.settings import Settings
from service.platform.storage.errors import MissingBlobError
from service.platform.storage.store import Store
from service.recordings.addresses import Presigner
from service.recordings.upload_actions import (
    FORGET_S,
    Announced,
    begin_part,
    finish_part,
    forget_part,
    part_too_large,
    reservation_ended,
)

router = Router(tags=["recordings"])

Number = Annotated[int, Path(ge=1, le=MAX_PARTS)]


@router.post("/recordings/{id}/parts/{number}/address")
def post_part_address(
    id: UUID, number: Number, body: NewPart, request: Request, identity: CurrentIdentity
) -> PartAddress:
    """Reserve a place in the store for a part, and say where its bytes are put. Asking again gives another place."""
    database: Database = request.app.state.database
    presigner = Presigner.of(request)
    largest = presigner.settings.max_part_bytes
    if body.size > largest:
        raise part_too_large(largest)
    if not presigner.uploads:
        raise _through_api(database, identity, id, number)
    announced = Announced(id, number, body.sha256, body.size)
    begun = begin_part(database, identity, announced, presigner.settings)
    if isinstance(begun, UploadPart):
        return PartAddress(part=PartView.model_validate(begun))
    return PartAddress(
        url=presigner.upload(begun, body.size), expires_at=presigner.expires_at, reservation=begun.rpartition("/")[2]
    )


@router.post("/recordings/{id}/parts/{number}/arrival")
async def post_part_arrival(
    id: UUID, number: Number, body: PutPart, request: Request, identity: CurrentIdentity
) -> PartView:
    """Acknowledge a part whose bytes were put at its address. Saying it again gives the same answer."""
    database: Database = request.app.state.database
    settings: Settings = request.app.state.settings
    writing = partial(request.app.state.threads.writing.run, caller=identity.person.id)
    put = f"{Announced(id, number, '', 0).prefix}/{body.reservation}"
    announced = await writing(_announced, database, identity, id, number, put)
    if isinstance(announced, UploadPart):
        return PartView.model_validate(announced)
    size = await _size(request.app.state.store, put, announced)
    if size > announced.size:
        await writing(forget_part, database, put)
    _refuse_other_size(size, announced)
    # The name tells which reservation was copied, so that a repeated request finds the copy.
    key = await writing(begin_part, database, identity, announced, settings, copied=body.reservation)
    if isinstance(key, UploadPart):
        await writing(forget_part, database, put)
        return PartView.model_validate(key)
    try:
        await _copy(request.app.state.store, put, key, announced)
        part = await writing(finish_part, database, identity, announced, settings, key, announced.size, put)
    except Exception:
        await writing(forget_part, database, key, wait_s=FORGET_S)
        raise
    return PartView.model_validate(part)


async def _copy(store: Store, put: str, key: str, announced: Announced) -> None:
    """Raises :class:`Problem` 409 ``reservation_ended``, ``part_size_differs``."""
    try:
        await store.copy(put, key)
    except MissingBlobError:  # the object was there a moment ago: its reservation ended meanwhile
        raise reservation_ended(announced.number) from None
    _refuse_other_size(await _size(store, key, announced), announced)


def _through_api(database: Database, identity: Identity, recording_id: UUID, number: int) -> Problem:
    """Return the problem for an uploader whose parts must go the other way."""
    with database.reading() as session:
        Access(session, identity).find(Recording, recording_id, "engineer")
    return conflict(
        "parts_through_api",
        "This service takes the bytes of parts itself.",
        f"PUT them at /v1/recordings/{recording_id}/parts/{number}; `upload.parts` of GET .../parts says which way.",
    )


def _announced(
    database: Database, identity: Identity, recording_id: UUID, number: int, key: str
) -> Announced | UploadPart:
    """Return the announcement of the object under this key; or the part, if a copy of this object is acknowledged.

    Raises :class:`Problem` 409 ``reservation_ended``.
    """
    with database.reading() as session:
        Access(session, identity).find(Recording, recording_id, "engineer")
        part = session.get(UploadPart, (recording_id, number))
        if part is not None and part.blob_key.endswith(f".{key.rpartition('/')[2]}"):
            return part
        blob = session.get(Blob, key)
        if blob is None or blob.state != "reserved" or blob.sha256 is None:
            raise reservation_ended(number)
        return Announced(recording_id, number, blob.sha256, blob.size)


_AGAIN = "Put the part's bytes at its address, then say so again; after `expires_at` ask for a new address."


async def _size(store: Store, key: str, announced: Announced) -> int:
    """Raises :class:`Problem` 409 ``part_not_put``."""
    try:
        return await store.size(key)
    except MissingBlobError:
        raise conflict(
            "part_not_put", f"Nothing was put at the address of part {announced.number}.", _AGAIN
        ) from None


def _refuse_other_size(size: int, announced: Announced) -> None:
    """Raises :class:`Problem` 409 ``part_size_differs``."""
    if size != announced.size:
        raise conflict(
            "part_size_differs",
            f"{size} bytes were put at the address of part {announced.number}; announced were {announced.size}.",
            "They are removed. Ask for a new address, with the part's size." if size > announced.size else _AGAIN,
        )
