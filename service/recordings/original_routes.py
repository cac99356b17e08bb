"""Routes that give the uploaded file back: as one stream, or part by part straight from the store."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from typing import Annotated
from urllib.parse import quote
from uuid import UUID

from fastapi import Depends, Request
from fastapi.responses import StreamingResponse

from apexcal.documents.recordings import Original, OriginalPart
from apexcal.documents.states import RecordingState
from service.platform.auth.access import CurrentIdentity, brief_access
from service.platform.db.recordings import Recording, UploadPart
from service.platform.http.problems import conflict
from service.platform.http.router import Router
from service.platform.http.store_problems import streamed
from service.platform.storage.errors import EXPIRED, MissingBlobError
from service.platform.storage.store import Store
from service.recordings.addresses import IN_PIECES, Presigner
from service.recordings.queries import parts_of

router = Router(tags=["recordings"])


def _complete(id: UUID, request: Request, identity: CurrentIdentity) -> tuple[Recording, Sequence[UploadPart]]:
    """A recording whose upload is complete, and its parts. The session ends here, before any byte is read."""
    with brief_access(request, identity) as access:
        row = access.find(Recording, id, "engineer")
        if row.state == RecordingState.UPLOADING:
            raise conflict(
                "upload_open", "The upload is not complete, so there is no file yet.", "Complete it first."
            )
        if row.layers_gone:
            raise MissingBlobError(EXPIRED)
        return row, parts_of(access.session, row)


Complete = Annotated[tuple[Recording, Sequence[UploadPart]], Depends(_complete)]


@router.get("/recordings/{id}/original", dependencies=[IN_PIECES], response_class=StreamingResponse)
async def get_original(request: Request, complete: Complete) -> StreamingResponse:
    """The uploaded file, byte for byte."""
    row, parts = complete
    return await streamed(
        _bytes_of(request.app.state.store, [part.blob_key for part in parts]),
        "application/octet-stream",
        {
            "Content-Length": str(row.size),
            "Content-Disposition": f"attachment; filename*=UTF-8''{quote(row.file_name, safe='')}",
        },
    )


@router.get("/recordings/{id}/original/parts", operation_id="recordings.list_original_parts")
def get_original_parts(request: Request, complete: Complete) -> Original:
    """The uploaded file's parts in order, each with the address where it is read straight from the store."""
    row, parts = complete
    presigner = Presigner.of(request)
    return Original(
        file_name=row.file_name,
        size=row.size,
        expires_at=presigner.expires_at if presigner.downloads else None,
        parts=[
            OriginalPart(
                number=part.number, size=part.size, sha256=part.sha256, url=presigner.download(part.blob_key)
            )
            for part in parts
        ],
    )


async def _bytes_of(store: Store, keys: Sequence[str]) -> AsyncIterator[bytes]:
    for key in keys:
        async for piece in store.read_all(key):
            yield piece
