"""Sends a source in numbered parts, a few at a time, leaving out the parts that the service has already.

Parts go to the service or straight into its store, whichever the service says.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial

from apexcal.documents.recordings import Parts, PartView, RecordingSummary, Upload
from apexcal.errors import ApiError, ClientError
from apexcal.http_rules import digest_field
from apexcal.presigned import PresignedStore
from apexcal.transport import HttpTransport, at
from apexcal.upload_sources import Source

MIB = 1024 * 1024
_DAMAGED_TRIES = 3

# Bytes so far, bytes in all.
OnSent = Callable[[int, int], None]
PutPart = Callable[[str, int, bytes, bytes], None]


@dataclass(frozen=True)
class SentParts:
    """What ``complete`` has to say."""

    parts: int
    size: int
    sha256: str


def send_parts(
    http: HttpTransport,
    recording: RecordingSummary,
    source: Source,
    on_progress: OnSent | None = None,
    connections: int = 3,
) -> SentParts:
    """Upload every part of ``source`` that the recording does not hold yet.

    Memory holds at most ``connections + 1`` parts. Raises :class:`ClientError` ``part_differs`` (an
    :class:`ApiError` where the service says it) when the recording holds parts of something else.
    """
    begun = http.get(at("recordings", recording.id, "parts"), Parts)
    stored = {part.number: part for part in begun.items}
    part_bytes = part_size(begun.upload, stored)
    parts = math.ceil(source.size / part_bytes)
    whole, sent = hashlib.sha256(), 0
    running: dict[Future[None], int] = {}
    with PresignedStore(http) as store, ThreadPoolExecutor(connections, thread_name_prefix="upload") as pool:
        put = store.put_part if begun.upload.parts == "presigned" else partial(_put_part, http)
        for number in range(1, parts + 1):
            data = source.read((number - 1) * part_bytes, part_bytes)
            whole.update(data)
            digest = hashlib.sha256(data)
            if number in stored:
                _require_same(number, stored[number], digest.hexdigest(), source.name)
                sent += len(data)
            else:
                running[pool.submit(put, str(recording.id), number, data, digest.digest())] = len(data)
            while len(running) > connections or (running and number == parts):
                sent += _settle(running)
                if on_progress:
                    on_progress(sent, source.size)
    return SentParts(parts, source.size, whole.hexdigest())


def part_size(upload: Upload, stored: dict[int, PartView]) -> int:
    """Bytes in every part but the last: what the upload began with, else what the service says."""
    if 1 in stored or len(stored) > 1:
        return max(part.size for part in stored.values())
    return upload.part_bytes


def _put_part(http: HttpTransport, recording_id: str, number: int, data: bytes, digest: bytes) -> None:
    """Send a part to the service, which stores it."""
    headers = {
        "Content-Digest": digest_field(digest),
        "Content-Type": "application/octet-stream",
    }
    for tried in range(1, _DAMAGED_TRIES + 1):
        try:
            http.send("PUT", at("recordings", recording_id, "parts", number), content=data, headers=headers)
            return
        except ApiError as error:
            if error.code != "checksum_mismatch" or tried == _DAMAGED_TRIES:
                raise


def _settle(running: dict[Future[None], int]) -> int:
    """Wait for one of the parts at least, and return the bytes of those that arrived. The first failure stops all."""
    done, others = wait(running, return_when=FIRST_COMPLETED)
    for part in done:
        if part.exception():
            for other in others:
                other.cancel()
            part.result()
    return sum(running.pop(part) for part in done)


def _require_same(number: int, begun: PartView, digest: str, name: str) -> None:
    if begun.sha256 != digest:
        raise ClientError(
            f"the recording's upload began with something else: its part {number} differs from {name}",
            "Upload it as a new recording (--new), or finish the old upload with the file that it began with.",
        )
