"""Routes of parts that go straight from the client into the store: ask where, put them there, say so.

S3 binds neither size nor checksum to the addresses that obstore signs. So the size is looked at when the part is
said to be there, and the worker compares the checksum of every part before it reads the file.
"""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Path, Request
from fastapi.concurrency import run_in_threadpool

from service.auth.access import Access, CurrentIdentity, Identity
from service.db.recordings import Blob, Recording, UploadPart
from service.db.session import Database
from service.http.problems import Problem
from service.recordings.presigning import Presigner
from service.recordings.schemas import MAX_PARTS, NewPart, PartAddress, PartView, PutPart
from service.recordings.uploads import Announced, begin_part, finish_part, part_too_large
from service.storage.errors import MissingBlobError
from service.storage.store import Store

router = APIRouter(tags=["recordings"])

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
    begun = begin_part(database, identity, Announced(id, number, body.sha256, body.size))
    if isinstance(begun, UploadPart):
        return PartAddress(part=PartView.model_validate(begun))
    return PartAddress(
        url=presigner.upload(begun), expires_at=presigner.expires_at, reservation=begun.rpartition("/")[2]
    )


@router.post("/recordings/{id}/parts/{number}/arrival")
async def post_part_arrival(
    id: UUID, number: Number, body: PutPart, request: Request, identity: CurrentIdentity
) -> PartView:
    """Acknowledge a part whose bytes were put at its address. Saying it again gives the same answer."""
    database: Database = request.app.state.database
    key = f"{Announced(id, number, '').prefix}/{body.reservation}"
    found = await run_in_threadpool(_announced, database, identity, id, number, key)
    if isinstance(found, UploadPart):
        return PartView.model_validate(found)
    await _require_there(request.app.state.store, key, found)
    return PartView.model_validate(await run_in_threadpool(finish_part, database, identity, found, key, found.size))


def _through_api(database: Database, identity: Identity, recording_id: UUID, number: int) -> Problem:
    """What whoever may upload this recording is told where parts go the other way."""
    with database.reading() as session:
        Access(session, identity).find(Recording, recording_id, "engineer")
    return Problem(
        409,
        "parts_through_api",
        "This service takes the bytes of parts itself.",
        f"PUT them at /v1/recordings/{recording_id}/parts/{number}; `upload.parts` of GET .../parts says which way.",
    )


def _announced(
    database: Database, identity: Identity, recording_id: UUID, number: int, key: str
) -> Announced | UploadPart:
    """What was announced of the object under this key; or the part, where it is acknowledged with this very object.

    Raises :class:`Problem` 409 ``reservation_ended``.
    """
    with database.reading() as session:
        Access(session, identity).find(Recording, recording_id, "engineer")
        part = session.get(UploadPart, (recording_id, number))
        if part is not None and part.blob_key == key:
            return part
        blob = session.get(Blob, key)
        if blob is None or blob.state != "reserved" or blob.sha256 is None:
            raise Problem(
                409,
                "reservation_ended",
                f"Nothing is reserved for part {number} under this name, or no longer.",
                "Ask for an address again, and put the bytes there.",
            )
        return Announced(recording_id, number, blob.sha256, blob.size)


async def _require_there(store: Store, key: str, announced: Announced) -> None:
    """Raises :class:`Problem` 409 ``part_not_put``, ``part_size_differs``."""
    again = "Put the part's bytes at its address, then say so again; after `expires_at` ask for a new address."
    try:
        size = await store.size(key)
    except MissingBlobError:
        raise Problem(
            409, "part_not_put", f"Nothing was put at the address of part {announced.number}.", again
        ) from None
    if size != announced.size:
        raise Problem(
            409,
            "part_size_differs",
            f"{size} bytes were put at the address of part {announced.number}; announced were {announced.size}.",
            again,
        )
