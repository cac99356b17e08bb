"""Correspondence sets: made of marks, or imported."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Annotated, NamedTuple
from uuid import UUID

from fastapi import Depends, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse, Response, StreamingResponse
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.requests import ClientDisconnect

from apexcal.documents.base import Sought
from apexcal.documents.correspondence_sets import BuildRequest, SelectionRequest, SetView, SetWithPairs
from service.annotations.disclosure_actions import answered_by_others, disclose_pairs, record_disclosures
from service.fleets.rigs import rig_camera
from service.pairs.label_files import FROM_ONE, is_labels, read_labels
from service.pairs.marked_pairs import build
from service.pairs.pair_files import MAX_BYTES, invalid, notes_on_image, read_csv, read_json
from service.pairs.sets import keep_set, pairs_of, set_in_pieces, set_view
from service.platform.auth.access import Access, CurrentIdentity, Identity, ReadAccess, WriteAccess, brief_access
from service.platform.broker.hints import hint
from service.platform.db.base import LIGHT_BYTES, PAIR_BYTES
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.detections import Detection
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Recording
from service.platform.db.session import Database, Encoded
from service.platform.http.etags import Conditional, Conditions, content_etag
from service.platform.http.limits import ConcurrencyLimiter, declared_length
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.problems import Problem, unprocessable
from service.platform.http.router import Router
from service.platform.http.threads import Threads
from service.platform.settings import MIB, get_settings
from service.platform.storage.quota import STORED_PAIR_BYTES, take_rows
from service.recordings.queries import find_camera

router = Router(tags=["calibrations"])

# What a selection has in common with the set that it is of.
_ORIGIN = ("fleet_id", "vehicle_id", "rig_id", "recording_id", "detection_id", "camera", "source")

# An import holds one of few places while its body arrives. 15 MB, as 100,000 pairs usually have, need 50 kB/s.
_RECEIVING_S = 300.0
# An import of 32 MiB takes some 130 MB while it is read.
_READ_TIMES = 4

_IMPORTED = {
    "requestBody": {
        "required": True,
        "content": {
            "text/csv": {
                "schema": {
                    "type": "string",
                    "description": "CSV, or labels.txt of the paper's toolbox.",
                    "example": "x,y,z,u,v,group\n4.1,0.2,0.9,961.2,540.8,1\n",
                }
            },
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


@router.post(
    "/detections/{detection_id}/correspondence-sets",
    operation_id="detections.create_correspondence_set",
    status_code=201,
    response_model=SetView,
)
def build_set(detection_id: UUID, body: BuildRequest, access: WriteAccess) -> JSONResponse:
    """Make pairs of what people marked; the same content is found again, with 200, and is the newest. [engineer]"""
    detection = access.find(Detection, detection_id, "engineer")
    recording = access.find(Recording, detection.recording_id, "engineer")
    camera = find_camera(access.session, recording.id, body.camera)
    built = build(
        access.session, detection, camera, exclude_flagged=body.exclude_flagged, machine_marks=body.machine_marks
    )
    # Its notes say what people answered.
    others = answered_by_others(access.session, detection.id, camera.id, access.person.id)
    record_disclosures(access.session, access.person.id, camera, others, "pairs")
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


class _Imported(NamedTuple):
    """Pairs as columns, and sentences on how the file was read."""

    columns: Encoded
    notes: list[str]


async def _importing(rig_id: UUID, request: Request, identity: CurrentIdentity) -> None:
    """Refuse who may not import to this rig, before the body is read."""

    def check() -> None:
        with brief_access(request, identity) as access:
            access.find(Rig, rig_id, "engineer")

    await request.app.state.threads.reading.run(check, caller=identity.person.id)


async def _imported(
    request: Request, identity: CurrentIdentity, allowed: Annotated[None, Depends(_importing)]
) -> AsyncIterator[_Imported]:
    """The pairs in the body, read before any transaction begins and in a thread."""
    media_type = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if media_type not in _READERS:
        raise Problem(
            415,
            "unsupported_media_type",
            f"Pairs come as text/csv or application/json, not as {media_type or 'an unnamed type'}.",
            "Name the type in Content-Type.",
        )
    arriving: ConcurrencyLimiter = request.app.state.arriving_imports
    threads: Threads = request.app.state.threads
    length = declared_length(request)
    async with arriving.take(identity.person.id, count=(MAX_BYTES if length is None else length) // MIB + 1):
        body = await _whole_body(request)
        async with threads.memory.take(identity.person.id, _READ_TIMES * len(body)):
            yield await threads.parse(_READERS[media_type], body, caller=identity.person.id)


async def _whole_body(request: Request) -> bytes:
    try:
        async with asyncio.timeout(_RECEIVING_S):
            return await request.body()
    except ClientDisconnect:
        raise Problem(400, "body_cut_off", "The connection ended before the pairs did.", "Send them again.") from None
    except TimeoutError:
        raise Problem(
            408,
            "body_too_slow",
            f"The pairs did not arrive within {_RECEIVING_S:.0f} s.",
            "Send them as CSV, which is half as long, or over a faster connection.",
        ) from None


def _read_text(body: bytes) -> _Imported:
    try:
        text = body.decode("utf-8")
    except UnicodeDecodeError as error:
        raise invalid(f"The file is no UTF-8 text: byte {error.start}.") from None
    if is_labels(text):
        return _Imported(Encoded(read_labels(text)), [FROM_ONE])
    return _Imported(Encoded(read_csv(text)), [])


def _read_json(body: bytes) -> _Imported:
    return _Imported(Encoded(read_json(body)), [])


_READERS: dict[str, Callable[[bytes], _Imported]] = {"text/csv": _read_text, "application/json": _read_json}


@router.post(
    "/rigs/{rig_id}/correspondence-sets",
    status_code=201,
    response_model=SetView,
    openapi_extra=_IMPORTED,
    max_body_size=MAX_BYTES,
)
def import_set(
    rig_id: UUID,
    camera: Sought,
    brought: Annotated[_Imported, Depends(_imported, scope="function")],
    access: WriteAccess,
) -> JSONResponse:
    """Import pairs, as CSV, JSON or the toolbox's labels.txt. [engineer]

    The same content is found again, with 200, and is the newest again.
    """
    rig = access.find(Rig, rig_id, "engineer")
    of = rig_camera(access.session, rig, camera)
    row = CorrespondenceSet(
        fleet_id=rig.fleet_id,
        vehicle_id=rig.vehicle_id,
        rig_id=rig.id,
        camera=of.name,
        source="import",
        pairs=brought.columns,
        notes=[*brought.notes, *notes_on_image(brought.columns, of)],
        created_by=access.person.id,
    )
    return _keep(access, row)


@router.post("/correspondence-sets/{set_id}/selections", status_code=201, response_model=SetView)
def select_pairs(set_id: UUID, body: SelectionRequest, access: WriteAccess) -> JSONResponse:
    """Make a set of a set's pairs without some; the same content is found again, with 200. [engineer]"""
    of = access.find(CorrespondenceSet, set_id, "engineer")
    left_out = set(body.leave_out)
    if max(left_out) >= of.count:
        raise unprocessable(
            "no_such_pair",
            f"The set has {of.count} pairs, numbered from 0; there is no pair {max(left_out)}.",
            "Give the numbers of its own pairs.",
        )
    if len(left_out) == of.count:
        raise unprocessable("nothing_left", "Without these the set has no pairs.", "Leave out fewer.")
    without = sorted(left_out)
    if of.left_out is not None:
        indices = of.own_indices(of.count + len(of.left_out))
        without = sorted([*of.left_out, *(indices[i] for i in left_out)])
    noun = "pair was" if len(left_out) == 1 else "pairs were"
    row = CorrespondenceSet(
        **{name: getattr(of, name) for name in _ORIGIN},
        whole_id=of.whole_id or of.id,
        left_out=without,
        count=of.count - len(left_out),
        flagged=of.flagged and _flagged_without(access.session, of.whole_id or of.id, set(without)),
        notes=[*of.notes, f"{len(left_out)} {noun} left out by hand."],
        created_by=access.person.id,
    )
    return _keep(access, row)


def _flagged_without(session: Session, whole_id: UUID, left_out: set[int]) -> int:
    flags = session.scalar(select(CorrespondenceSet.pairs["flagged"]).where(CorrespondenceSet.id == whole_id))
    return sum(flag for i, flag in enumerate(flags or ()) if i not in left_out)


def _keep(access: WriteAccess, candidate: CorrespondenceSet) -> JSONResponse:
    row, is_new = keep_set(access.session, candidate)
    if is_new:
        if row.whole_id is None:
            take_rows(access.session, row.fleet_id, STORED_PAIR_BYTES * row.count, get_settings().fleet_quota_bytes)
        hint(access.session, row.fleet_id, "detection" if row.detection_id else "rig", row.detection_id or row.rig_id)
    return access.answer(set_view(row), 201 if is_new else 200)


class _Read(NamedTuple):
    """A set without its pairs, and the whole answer where it is small."""

    pair_set: CorrespondenceSet
    answer: bytes | None


async def _without_large(set_id: UUID, request: Request, identity: CurrentIdentity, conditions: Conditional) -> _Read:
    """The set, with its pairs where they are few. The session ends here: none is held while the answer is sent."""
    threads: Threads = request.app.state.threads
    look = (_look_up, request.app.state.database, identity, set_id, conditions)
    return await threads.reading.run(*look, caller=identity.person.id)


def _look_up(database: Database, identity: Identity, set_id: UUID, conditions: Conditions) -> _Read:
    with database.reading() as session:
        access = Access(session, identity)
        row = access.find(CorrespondenceSet, set_id)
        if row.source == "annotations":
            access.need(row.fleet_id, "reviewer")
        conditions.offer(content_etag(row.content_hash))
        columns = row.columns if PAIR_BYTES * row.count <= LIGHT_BYTES else None
        disclose_pairs(access, database, row, "pairs")
        return _Read(row, None if columns is None else b"".join(set_in_pieces(row, columns)))


async def _limited(
    request: Request, identity: CurrentIdentity, read: Annotated[_Read, Depends(_without_large)]
) -> AsyncIterator[_Read]:
    """The set, while many pairs are in memory: until the answer is sent."""
    if read.answer is not None:
        yield read
        return
    threads: Threads = request.app.state.threads
    async with threads.memory.take(identity.person.id, PAIR_BYTES * read.pair_set.count):
        yield read


@router.get("/correspondence-sets/{set_id}", response_model=SetWithPairs)
async def read_set(request: Request, read: Annotated[_Read, Depends(_limited)]) -> Response:
    """A correspondence set with its pairs, in the form in which they are imported. [reviewer, if made of marks]

    What one answers afterwards on the vertices of such a set counts as reviewed.
    """
    pair_set, answer = read
    headers = {"ETag": content_etag(pair_set.content_hash)}
    if answer is not None:
        return Response(answer, media_type="application/json", headers=headers)
    columns = await run_in_threadpool(pairs_of, request.app.state.database, pair_set.id)
    return StreamingResponse(set_in_pieces(pair_set, columns), media_type="application/json", headers=headers)


@router.get("/rigs/{rig_id}/correspondence-sets")
def list_sets(rig_id: UUID, access: ReadAccess, window: Paging) -> Page[SetView]:
    """A rig's correspondence sets, the last made first, without their pairs; those made of marks for reviewers."""
    rig = access.find(Rig, rig_id)
    statement = select(CorrespondenceSet).where(CorrespondenceSet.rig_id == rig.id)
    if not access.sees_answers(rig.fleet_id):
        statement = statement.where(CorrespondenceSet.source == "import")
    rows, following = fetch(access.session, statement, CorrespondenceSet.id, window, newest_first=True)
    return Page(items=[set_view(row) for row in rows], next=following)
