"""Bytes straight to and from the service's blob store, at presigned addresses that the service hands out.

The store gets no token of ours: the address is all that it asks for.
"""

from __future__ import annotations

import base64
import hashlib
import time
from urllib.parse import urlsplit

import httpx

from apexcal.documents.recordings import PartAddress, PartView
from apexcal.errors import ApiError, UnreachableError
from apexcal.http_rules import BUSY, PAUSES_S, ask_again
from apexcal.transport import TIMEOUT, HttpTransport, at

# The bytes were damaged on their way, or the store is away or busy.
_AWAY = (*BUSY, 400, 500)
_CAN_IT = (
    "Can this machine reach that address? The operator can let the bytes go through the service instead "
    "(APEXCAL_UPLOADS=api, APEXCAL_DOWNLOADS=api)."
)
# What the service says of a part that has not arrived as it was announced.
_NOT_THERE = ("part_not_put", "part_size_differs", "reservation_ended")


class EndedAddressError(UnreachableError):
    """The store refuses this address; most likely its time is over, and another is to be asked for."""

    def __init__(self, url: str) -> None:
        super().__init__(f"the store at {urlsplit(url).netloc} refuses an address of the service", _CAN_IT)


class PresignedStore:
    """One client's connections to the store. Safe to share between threads; close it, or use it as a context."""

    def __init__(self, service: HttpTransport) -> None:
        self._service = service
        self._http = httpx.Client(timeout=TIMEOUT)

    def __enter__(self) -> PresignedStore:
        return self

    def __exit__(self, *error: object) -> None:
        self._http.close()

    def put_part(self, recording_id: str, number: int, data: bytes, digest: bytes) -> None:
        """Put a part of a recording into the store and tell the service. Raises UnreachableError, ApiError."""
        path = at("recordings", recording_id, "parts", number)
        announced = {"size": len(data), "sha256": digest.hex()}
        for pause_s in (*PAUSES_S, None):
            address = self._service.post(f"{path}/address", PartAddress, announced)
            if address.part or self._put(path, address, data, last=pause_s is None):
                return
            time.sleep(pause_s or 0.0)

    def get(self, url: str, start: int, length: int) -> bytes:
        """A range of an object. Raises UnreachableError, EndedAddressError."""
        headers = {"Range": f"bytes={start}-{start + length - 1}"}
        try:
            response: httpx.Response = ask_again(
                lambda: self._http.get(url, headers=headers), (httpx.TransportError,), PAUSES_S, _AWAY
            )
        except httpx.TransportError as error:
            raise _unreachable(url, str(error)) from error
        if response.status_code == httpx.codes.FORBIDDEN:
            raise EndedAddressError(url)
        if response.status_code != httpx.codes.PARTIAL_CONTENT or len(response.content) != length:
            raise _unreachable(url, f"it answered {response.status_code}")
        return response.content

    def _put(self, path: str, address: PartAddress, data: bytes, *, last: bool) -> bool:
        """Whether the part is acknowledged; False where it is to be tried again. The ``last`` try raises instead."""
        url = address.url or ""
        md5 = hashlib.md5(data, usedforsecurity=False).digest()
        # S3 compares Content-MD5 with what arrived, so damage on the way shows at once and not in the worker.
        headers = {"Content-MD5": base64.b64encode(md5).decode(), "Content-Type": "application/octet-stream"}
        try:
            response = self._http.put(url, content=data, headers=headers)
        except httpx.TransportError as error:
            if last:
                raise _unreachable(url, str(error)) from error
            return False
        if not response.is_success:
            if last or response.status_code not in (*_AWAY, httpx.codes.FORBIDDEN):
                raise _unreachable(url, f"it answered {response.status_code}")
            return False
        try:
            self._service.post(f"{path}/arrival", PartView, {"reservation": address.reservation})
        except ApiError as error:
            if last or error.code not in _NOT_THERE:
                raise
            return False
        return True


def _unreachable(url: str, reason: str) -> UnreachableError:
    # The address itself stays out of sentences: whoever has it may use it.
    return UnreachableError(
        f"the store at {urlsplit(url).netloc}, where the service keeps recordings, cannot be used: {reason}", _CAN_IT
    )
