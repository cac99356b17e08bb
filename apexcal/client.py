"""The HTTP client: everything that the service can do, from Python.

>>> client = Client("http://127.0.0.1:8000", token="apx_...")
>>> recording = client.recordings.upload(Path("walk.bag"), vehicle["id"], rig["id"])
>>> recording = client.wait(recording)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit
from uuid import UUID

from apexcal.errors import ApiError, ClientError, FailedError, InputError, TokenError, TooSlowError, UnreachableError
from apexcal.resources.calibrations import Calibrations, CorrespondenceSets
from apexcal.resources.detections import Detections
from apexcal.resources.exports import Exports
from apexcal.resources.fleet_requests import FleetRequests
from apexcal.resources.fleets import Fleets, Vehicles
from apexcal.resources.marking import Marking
from apexcal.resources.recordings import Recordings
from apexcal.transport import Document, Transport, at

__all__ = [
    "ApiError",
    "Client",
    "ClientError",
    "FailedError",
    "InputError",
    "TokenError",
    "TooSlowError",
    "UnreachableError",
]

Listener = Callable[[float, str], None]

# A fleet request in which some vehicles failed ended as it may: its counts say how many.
_ENDED_WELL = ("ready", "done", "done_with_failures")
_ENDED_BADLY = ("failed", "cancelled")


class Client:
    """One person or program at one service. Safe to share between threads; close it, or use it as a context."""

    def __init__(
        self, base_url: str = "http://127.0.0.1:8000", token: str | None = None, timeout_s: float | None = None
    ) -> None:
        self._http = Transport(base_url, token, timeout_s=timeout_s)
        self.base_url = self._http.base_url
        self.fleets = Fleets(self._http)
        self.vehicles = Vehicles(self._http)
        self.recordings = Recordings(self._http)
        self.detections = Detections(self._http)
        self.marking = Marking(self._http)
        self.correspondence_sets = CorrespondenceSets(self._http)
        self.calibrations = Calibrations(self._http)
        self.exports = Exports(self._http)
        self.fleet_requests = FleetRequests(self._http)

    @classmethod
    def sign_in(cls, link: str, base_url: str | None = None) -> Client:
        """Sign in with a one-time link, consuming it, and keep the session in this client.

        ``base_url`` is where this client reaches the service when that is not where the link points.
        Raises :class:`ApiError` ``link_used`` or ``link_expired``.
        """
        parts = urlsplit(link)
        if not parts.fragment:
            raise ClientError("this is no sign-in link", "It looks like https://example.org/sign-in#secret.")
        client = cls(base_url or f"{parts.scheme}://{parts.netloc}{parts.path.removesuffix('/sign-in')}")
        try:
            client._http.post("/sign-in", {"link": parts.fragment})
        except BaseException:
            client.close()
            raise
        return client

    def me(self) -> Document:
        """Who this is: ``{"id", "name", "is_owner", "fleets"}``."""
        return self._http.get("/me")

    def sign_out(self) -> None:
        """End the session."""
        self._http.post("/sign-out")

    def job(self, job_id: int) -> Document:
        """One job: state, attempt, progress."""
        return self._http.get(at("jobs", job_id))

    def jobs(self, *, fleet_id: UUID | str | None = None, state: str | None = None) -> Iterator[Document]:
        """Jobs, of one fleet or in one state (queued, running, done, failed, cancelled)."""
        return self._http.items("/jobs", fleet_id=fleet_id, state=state)

    def wait(
        self, work: Document, *, on_progress: Listener | None = None, timeout_s: float | None = None
    ) -> Document:
        """Follow a recording, study, detection, calibration, fleet request or job to its end; it as it is then.

        ``on_progress(fraction, message)`` hears of every change. Raises :class:`FailedError` where the work failed
        or was cancelled, :class:`TooSlowError` after ``timeout_s`` seconds (the work goes on).
        """
        path, what = _address(work)
        started = time.monotonic()
        heard: tuple[float, str] | None = None
        while True:
            work = self._http.get(path)
            state = str(work["state"])
            progress = progress_of(work)
            if on_progress and progress != heard:
                on_progress(*progress)
                heard = progress
            if state in _ENDED_WELL:
                return work
            if state in _ENDED_BADLY:
                raise FailedError(what, state, work.get("problem"))
            waited = time.monotonic() - started
            if timeout_s is not None and waited > timeout_s:
                raise TooSlowError(
                    f"{what} is still {state} after {timeout_s:.0f} s", "It goes on; look again later."
                )
            time.sleep(min(0.1 + waited / 20, 1.0))

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def progress_of(work: Document) -> tuple[float, str]:
    """Fraction and message of a resource or job, from its own progress or its job's."""
    state = str(work["state"])
    if state in _ENDED_WELL:
        return 1.0, state
    job = work.get("job")
    known: Document = job if isinstance(job, dict) else {}
    progress: Any = work.get("progress") or known.get("progress") or {}
    left = work.get("seconds_left") or known.get("seconds_left")
    message = str(progress.get("message") or state)
    return float(progress.get("fraction") or 0.0), f"{message}, {time_left(left)}" if left else message


def time_left(seconds: float) -> str:
    """About how long something still takes, in words: ``about 3 min left``."""
    if seconds < 90:
        return f"about {max(5 * round(seconds / 5), 5)} s left"
    return f"about {round(seconds / 60)} min left" if seconds < 5400 else f"about {seconds / 3600:.1f} h left"


def _address(work: Document) -> tuple[str, str]:
    """The path of a resource and what to call it, told from its own fields."""
    if "file_name" in work:
        return at("recordings", work["id"]), f"the recording {work['name']!r}"
    if "detector" in work:
        return at("detections", work["id"]), "the detection"
    if "counts" in work:
        return at("fleet-requests", work["id"]), "the fleet request"
    if "runs" in work:
        return at("calibrations", work["id"]), "the calibration"
    if "attempt" in work:
        return at("jobs", work["id"]), f"job {work['id']} ({work.get('kind', 'of unknown kind')})"
    if "detection_id" in work:
        return at("clock-offsets", work["id"]), "the clock offset"
    if "region" in work:
        return at("region-previews", work["id"]), "the region preview"
    if "result" in work:
        return at("region-suggestions", work["id"]), "the region suggestion"
    raise ValueError(f"nothing to wait for: {sorted(work)}")
