"""Sends a source in numbered parts, a few at a time, leaving out the parts that the service has already.

Parts go to the service or straight into its store, whichever the service says.
"""

from __future__ import annotations

import base64
import hashlib
import math
import threading
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial

from apexcal.documents.recordings import Parts, PartView, RecordingSummary, Upload
from apexcal.errors import ApiError, ClientError
from apexcal.presigned import PresignedStore
from apexcal.transport import Transport, at
from apexcal.upload_sources import Source

MIB = 1024 * 1024
_DAMAGED_TRIES = 3

Progress = Callable[[int, int], None]
PutPart = Callable[[str, int, bytes, bytes], None]


@dataclass(frozen=True)
class Sent:
    """What ``complete`` has to say."""

    parts: int
    size: int
    sha256: str


def send_parts(
    http: Transport,
    recording: RecordingSummary,
    source: Source,
    on_progress: Progress | None = None,
    connections: int = 3,
) -> Sent:
    """Upload every part of ``source`` that the recording does not hold yet.

    Memory holds at most ``connections + 1`` parts. ``on_progress(bytes so far, bytes in all)`` is called from
    several threads, one at a time. Raises :class:`ClientError` ``part_differs`` (an :class:`ApiError` where the
    service says it) when the recording holds parts of something else.
    """
    begun = http.get(at("recordings", recording.id, "parts"), Parts)
    held = {part.number: part for part in begun.items}
    part_bytes = part_size(begun.upload, held)
    parts = math.ceil(source.size / part_bytes)
    counter = _Counter(source.size, on_progress)
    whole = hashlib.sha256()
    with PresignedStore(http) as store, ThreadPoolExecutor(connections, thread_name_prefix="upload") as pool:
        put = store.put_part if begun.upload.parts == "presigned" else partial(_put_part, http)
        running: set[Future[None]] = set()
        for number in range(1, parts + 1):
            data = source.read((number - 1) * part_bytes, part_bytes)
            whole.update(data)
            digest = hashlib.sha256(data)
            if number in held:
                _require_same(number, held[number], digest.hexdigest(), source.name)
                counter.add(len(data))
                continue
            if len(running) > connections:
                running = _settle(running)
            running.add(pool.submit(_send, put, str(recording.id), number, data, digest.digest(), counter))
        while running:
            running = _settle(running)
    return Sent(parts, source.size, whole.hexdigest())


def part_size(upload: Upload, held: dict[int, PartView]) -> int:
    """Bytes in every part but the last: what the upload began with, else what the service says."""
    if 1 in held or len(held) > 1:
        return max(part.size for part in held.values())
    return upload.part_bytes


def _send(put: PutPart, recording_id: str, number: int, data: bytes, digest: bytes, counter: _Counter) -> None:
    put(recording_id, number, data, digest)
    counter.add(len(data))


def _put_part(http: Transport, recording_id: str, number: int, data: bytes, digest: bytes) -> None:
    """Send a part to the service, which stores it."""
    headers = {
        "Content-Digest": f"sha-256=:{base64.b64encode(digest).decode()}:",
        "Content-Type": "application/octet-stream",
    }
    for tried in range(1, _DAMAGED_TRIES + 1):
        try:
            http.send("PUT", at("recordings", recording_id, "parts", number), content=data, headers=headers)
            return
        except ApiError as error:
            if error.code != "checksum_mismatch" or tried == _DAMAGED_TRIES:
                raise


def _settle(running: set[Future[None]]) -> set[Future[None]]:
    """Wait for one of the parts at least; the first failure stops the upload."""
    done, still = wait(running, return_when=FIRST_COMPLETED)
    for part in done:
        try:
            part.result()
        except BaseException:
            for other in still:
                other.cancel()
            raise
    return still


def _require_same(number: int, held: PartView, digest: str, name: str) -> None:
    if held.sha256 != digest:
        raise ClientError(
            f"the recording's upload began with something else: its part {number} differs from {name}",
            "Upload it as a new recording (--new), or finish the old upload with the file that it began with.",
        )


class _Counter:
    """Bytes so far, told to one listener."""

    def __init__(self, total: int, listener: Progress | None) -> None:
        self._total = total
        self._listener = listener
        self._done = 0
        self._lock = threading.Lock()

    def add(self, count: int) -> None:
        with self._lock:
            self._done += count
            if self._listener:
                self._listener(self._done, self._total)
