"""Rules of uploads: parts are numbered from 1, each one an object with a checksum, sent in any order, any number of
times. A part is acknowledged once its object is durable and its bytes have the checksum that was announced."""

from __future__ import annotations

import hashlib
from base64 import b64decode
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass
from uuid import UUID

from fastapi import Request
from sqlalchemy import delete, select
from starlette.requests import ClientDisconnect

from apexcal.documents.recordings import Completion, Upload
from apexcal.documents.states import RecordingState
from service.platform.auth.access import Access, Identity
from service.platform.db.clock import now
from service.platform.db.recordings import Blob, Recording, UploadPart
from service.platform.db.session import Database
from service.platform.http.problems import Problem, conflict
from service.platform.settings import Settings
from service.platform.storage.blobs import condemn, give_up, keep, reserve
from service.platform.storage.errors import ReservationEndedError
from service.platform.storage.quota import coming, take
from service.recordings.addresses import Presigner


def check_complete(row: Recording, parts: Sequence[UploadPart], declared: Completion) -> bool:
    """True where ingestion may start, False where it did already after the same declaration.

    Raises :class:`Problem` 409 ``parts_missing``, ``size_differs``, ``upload_closed``.
    """
    numbers = {part.number for part in parts}
    missing = [number for number in range(1, declared.parts + 1) if number not in numbers]
    if missing:
        raise conflict(
            "parts_missing",
            f"{len(missing)} of {declared.parts} parts have not arrived, the first of them {missing[0]}.",
            "Send the parts listed in `missing`, then complete again.",
            missing=missing[:1000],
        )
    size = sum(part.size for part in parts)
    if len(numbers) != declared.parts or size != declared.size:
        raise conflict(
            "size_differs",
            f"{len(numbers)} parts of {size} bytes arrived; declared are {declared.parts} of {declared.size}.",
            "Compare with GET .../parts. Did the file change meanwhile? Then upload it as a new recording.",
        )
    if row.state == RecordingState.UPLOADING:
        return True
    if row.sha256 != declared.sha256:
        raise conflict(
            "upload_closed",
            f"This upload was completed with the SHA-256 {row.sha256}, not {declared.sha256}.",
            "Make a new recording to upload another file.",
        )
    return False


EXPIRED = "upload_expired"


@dataclass(frozen=True)
class Announced:
    """A part as its request announces it; ``size`` is the most that it can be where the request does not say it."""

    recording_id: UUID
    number: int
    sha256: str
    size: int

    @property
    def prefix(self) -> str:
        """Return the beginning of the part's keys."""
        return f"recordings/{self.recording_id}/parts/{self.number}"


def how_to_upload(request: Request, row: Recording) -> Upload:
    """Return how parts are sent, how large they are, and when the upload ends without another one."""
    presigner = Presigner.of(request)
    return Upload(
        part_bytes=presigner.settings.part_bytes,
        max_part_bytes=presigner.settings.max_part_bytes,
        parts="presigned" if presigner.uploads else "api",
        expires_at=row.expires_at if row.state == RecordingState.UPLOADING else None,
    )


class Body:
    """A request's body as it passes through: counted and hashed, and never more than ``limit`` bytes.

    It ends instead of raising, because a store may wrap what its source raises; look at it after the stream.
    """

    def __init__(self, request: Request, limit: int) -> None:
        self._request = request
        self._limit = limit
        self._hash = hashlib.sha256()
        self.size = 0
        self.too_large = False
        self.cut_off = False

    async def __aiter__(self) -> AsyncIterator[bytes]:
        try:
            async for chunk in self._request.stream():
                self.size += len(chunk)
                if self.size > self._limit:
                    self.too_large = True
                    return
                if chunk:
                    self._hash.update(chunk)
                    yield chunk
        except ClientDisconnect:
            self.cut_off = True

    def check(self, announced: Announced) -> None:
        """Raises :class:`Problem` unless the whole body came and has the announced checksum."""
        if self.too_large:
            raise part_too_large(self._limit)
        if self.cut_off:
            raise Problem(400, "upload_cut_off", "The connection ended before the part did.", "Send the part again.")
        if self.size == 0:
            raise Problem(400, "empty_part", "The part has no bytes.", "Send the part's bytes as the request's body.")
        if self._hash.hexdigest() != announced.sha256:
            raise Problem(
                400,
                "checksum_mismatch",
                f"Part {announced.number} arrived with the SHA-256 {self._hash.hexdigest()}, announced was "
                f"{announced.sha256}. Nothing of it was stored.",
                "Send the part again; if it happens again, look for a proxy or disk that changes bytes.",
            )


def declared_sha256(request: Request) -> str:
    """The SHA-256 of Content-Digest (RFC 9530) in hexadecimal. Raises :class:`Problem` ``checksum_required``."""
    for item in request.headers.get("content-digest", "").split(","):
        name, _, value = item.strip().partition("=")
        if name.lower() == "sha-256" and len(value) > 2 and value[0] == value[-1] == ":":
            try:
                digest = b64decode(value[1:-1], validate=True)
            except ValueError:  # no base64, or no ASCII
                continue
            if len(digest) == 32:
                return digest.hex()
    raise Problem(
        400,
        "checksum_required",
        "The part comes without the SHA-256 of its bytes.",
        "Send the header Content-Digest: sha-256=:<base64 of the 32 bytes>:",
    )


def part_too_large(limit: int) -> Problem:
    """A part that is larger than parts may be."""
    return Problem(
        413, "part_too_large", f"A part has at most {limit} bytes.", "Cut the file into parts of `upload.part_bytes`."
    )


def begin_part(
    database: Database, identity: Identity, announced: Announced, settings: Settings, *, copied: str = ""
) -> str | UploadPart:
    """Return a reserved key for a part; or the part itself, if these bytes are acknowledged already.

    ``copied``: the key that the client uploaded to, if the part was copied from there; its quota is already taken.
    Raises :class:`QuotaExceededError`, and :class:`Problem` ``not_found``, ``role_too_low``, ``part_differs``,
    ``upload_closed``, ``upload_expired``.
    """
    with database.writing() as session:
        recording = Access(session, identity).find(Recording, announced.recording_id, "engineer", lock=True)
        part = session.get(UploadPart, (announced.recording_id, announced.number))
        if part is not None:
            _refuse_other_bytes(part, announced)
            if session.scalar(select(Blob.state).where(Blob.key == part.blob_key)) == "stored":
                return part
        _refuse_closed(recording)
        if part is not None:
            # Its object is lost, whatever lost it: these bytes take its place.
            session.execute(delete(UploadPart).where(UploadPart.blob_key == part.blob_key))
        if not copied:
            # The announced size of the file has its room already; beyond it each part takes its own.
            needed = coming(session, recording) + announced.size
            take(session, recording, needed, settings.fleet_quota_bytes)
        suffix = f".{copied}" if copied else ""
        return reserve(session, announced.prefix, suffix=suffix, size=announced.size, sha256=announced.sha256)


def finish_part(
    database: Database,
    identity: Identity,
    announced: Announced,
    settings: Settings,
    key: str,
    size: int,
    put: str | None = None,
) -> UploadPart:
    """Acknowledge a part whose object is durable. Of twins one wins, and the others' objects are condemned.

    ``put`` is the key that the object was copied from, where clients have an address of that; it is condemned.
    Raises :class:`Problem` as :func:`begin_part`, and 409 ``reservation_ended``.
    """
    with database.writing() as session:
        recording = Access(session, identity).find(Recording, announced.recording_id, "engineer", lock=True)
        earlier = session.get(UploadPart, (announced.recording_id, announced.number))
        if earlier is not None:
            _refuse_other_bytes(earlier, announced)
            for lost in (key, put or key):
                give_up(session, lost)
            return earlier
        _refuse_closed(recording)
        try:
            keep(session, key, size=size, sha256=announced.sha256)
        except ReservationEndedError:
            raise reservation_ended(announced.number) from None
        if put:
            condemn(session, [put])
        part = UploadPart(
            recording_id=recording.id, number=announced.number, blob_key=key, size=size, sha256=announced.sha256
        )
        session.add(part)
        recording.expires_at = session.scalar(select(now(3600 * settings.upload_hours)))
        return part


def reservation_ended(number: int) -> Problem:
    """A part whose place in the store is none any more."""
    return conflict(
        "reservation_ended",
        f"Nothing is reserved for part {number} under this name, or no longer.",
        "Send the part again; where parts go straight to the store, ask for an address again and put it there.",
    )


# A request that fails may have waited for locks already. What it does not forget ends with its reservation.
FORGET_S = 0.5


def forget_part(database: Database, key: str) -> None:
    """Give up a reserved key and what was written to it, unless the part was acknowledged after all."""
    with database.writing() as session:
        give_up(session, key)


def _refuse_other_bytes(part: UploadPart, announced: Announced) -> None:
    if part.sha256 != announced.sha256:
        raise conflict(
            "part_differs",
            f"Part {part.number} was acknowledged with the SHA-256 {part.sha256}; these are other bytes.",
            "Did the file change while it was uploaded? Make a new recording for the changed file.",
            sha256=part.sha256,
        )


def refuse_expired(recording: Recording) -> None:
    """Raises :class:`Problem` 410 where the upload ended because nobody went on with it."""
    if recording.problem and recording.problem.get("code") == EXPIRED:
        raise Problem(410, EXPIRED, recording.problem["detail"], recording.problem["hint"])


def _refuse_closed(recording: Recording) -> None:
    refuse_expired(recording)
    if recording.state != RecordingState.UPLOADING:
        raise conflict(
            "upload_closed",
            f"The upload of this recording is complete: it is {recording.state}.",
            "Make a new recording to upload another file.",
        )
