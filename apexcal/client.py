"""The HTTP client: everything that the service can do, from Python.

>>> client = Client("http://127.0.0.1:8000", token="apx_...")
>>> recording = client.recordings.upload(Path("walk.bag"), vehicle.id, rig.id)
>>> recording = client.wait(recording)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, overload
from urllib.parse import urlsplit
from uuid import UUID

from pydantic import BaseModel

from apexcal.documents.analyses import AnalysisView
from apexcal.documents.calibrations import CalibrationView, ProgressView
from apexcal.documents.detections import DetectionView
from apexcal.documents.fleet_requests import FleetRequestView
from apexcal.documents.jobs import JobProgress, JobView, ProblemView
from apexcal.documents.people import Me
from apexcal.documents.recordings import RecordingSummary, RecordingView
from apexcal.errors import ApiError, ClientError, InputError, TokenError, UnreachableError
from apexcal.resources.analyses import Analyses
from apexcal.resources.calibrations import Calibrations, CorrespondenceSets
from apexcal.resources.detections import DetectionRuns
from apexcal.resources.exports import Exports
from apexcal.resources.fleet_requests import FleetRequests
from apexcal.resources.fleets import Fleets, Vehicles
from apexcal.resources.imports import Imports
from apexcal.resources.marking import Marking
from apexcal.resources.recordings import Recordings
from apexcal.transport import HttpTransport, at

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

Work = TypeVar("Work", bound=AnalysisView | DetectionView | CalibrationView | FleetRequestView | JobView)

# A fleet request with failed vehicles has ended normally; its counts say how many failed.
_ENDED_WELL = ("ready", "done", "done_with_failures")
_ENDED_BADLY = ("failed", "cancelled")


class FailedError(ClientError):
    """Long work ended in failure; ``problem`` is the reason that the service gives."""

    def __init__(self, what: str, state: str, problem: ProblemView | None) -> None:
        self.state = state
        self.problem = problem.model_dump(mode="json", exclude_unset=True) if problem else {}
        self.code = str(self.problem.get("code") or state)
        reason = self.problem.get("detail") or self.problem.get("message") or self.problem.get("title")
        super().__init__(f"{what} {state}" + (f": {reason}" if reason else ""), str(self.problem.get("hint") or ""))


class TooSlowError(ClientError):
    """Long work did not end within the time that the caller allowed. It goes on."""


class Client:
    """One person or program at one service. Safe to share between threads; close it, or use it as a context."""

    def __init__(
        self, base_url: str = "http://127.0.0.1:8000", token: str | None = None, timeout_s: float | None = None
    ) -> None:
        self._http = HttpTransport(base_url, token, timeout_s=timeout_s)
        self.base_url = self._http.base_url
        self.fleets = Fleets(self._http)
        self.vehicles = Vehicles(self._http)
        self.recordings = Recordings(self._http)
        self.detections = DetectionRuns(self._http)
        self.marking = Marking(self._http)
        self.correspondence_sets = CorrespondenceSets(self._http)
        self.calibrations = Calibrations(self._http)
        self.exports = Exports(self._http)
        self.imports = Imports(self._http)
        self.fleet_requests = FleetRequests(self._http)
        self.analyses = Analyses(self._http)

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
            client._http.post("/sign-in", Me, {"link": parts.fragment})
        except BaseException:
            client.close()
            raise
        return client

    def me(self) -> Me:
        """Who this is, and the roles that they have."""
        return self._http.get("/me", Me)

    def sign_out(self) -> None:
        """End the session."""
        self._http.create("/sign-out")

    def job(self, job_id: int) -> JobView:
        """One job: state, attempt, progress."""
        return self._http.get(at("jobs", job_id), JobView)

    def jobs(self, *, fleet_id: UUID | str | None = None, state: str | None = None) -> Iterator[JobView]:
        """Jobs, of one fleet or in one state (queued, running, done, failed, cancelled)."""
        return self._http.items("/jobs", JobView, fleet_id=fleet_id, state=state)

    @overload
    def wait(
        self, work: RecordingSummary, *, on_progress: Listener | None = None, timeout_s: float | None = None
    ) -> RecordingView: ...
    @overload
    def wait(self, work: Work, *, on_progress: Listener | None = None, timeout_s: float | None = None) -> Work: ...
    def wait(self, work: Any, *, on_progress: Listener | None = None, timeout_s: float | None = None) -> Any:
        """Follow a recording, analysis, detection, calibration, fleet request or job to its end; it as it is then.

        ``on_progress(fraction, message)`` hears of every change. Raises :class:`FailedError` where the work failed
        or was cancelled, :class:`TooSlowError` after ``timeout_s`` seconds (the work goes on).
        """
        path, kind, what = _address(work)
        started = time.monotonic()
        heard: tuple[float, str] | None = None
        while True:
            work = self._http.get(path, kind)
            progress = progress_of(work)
            if on_progress and progress != heard:
                on_progress(*progress)
                heard = progress
            if work.state in _ENDED_WELL:
                return work
            if work.state in _ENDED_BADLY:
                raise FailedError(what, work.state, getattr(work, "problem", None))
            waited = time.monotonic() - started
            if timeout_s is not None and waited > timeout_s:
                raise TooSlowError(
                    f"{what} is still {work.state} after {timeout_s:.0f} s", "It goes on; look again later."
                )
            time.sleep(min(0.1 + waited / 20, 1.0))

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def progress_of(work: Any) -> tuple[float, str]:
    """Fraction and message of a resource or job, from its own progress or its job's."""
    if work.state in _ENDED_WELL:
        return 1.0, work.state
    job: JobView | None = getattr(work, "job", None)
    progress: JobProgress | ProgressView | None = getattr(work, "progress", None) or (job.progress if job else None)
    left = getattr(work, "seconds_left", None) or (job.seconds_left if job else None)
    message = progress.message if progress and progress.message else work.state
    fraction = progress.fraction if progress else None
    return fraction or 0.0, f"{message}, {time_left(left)}" if left else message


def time_left(seconds: float) -> str:
    """About how long something still takes, in words: ``about 3 min left``."""
    if seconds < 90:
        return f"about {max(5 * round(seconds / 5), 5)} s left"
    return f"about {round(seconds / 60)} min left" if seconds < 5400 else f"about {seconds / 3600:.1f} h left"


# What is followed: where it stands, as what it is read, and what to call it.
_FOLLOWED: dict[type[Any], tuple[str, type[BaseModel], str]] = {
    RecordingSummary: ("recordings", RecordingView, "the recording {0.name!r}"),
    DetectionView: ("detections", DetectionView, "the detection"),
    FleetRequestView: ("fleet-requests", FleetRequestView, "the fleet request"),
    CalibrationView: ("calibrations", CalibrationView, "the calibration"),
    JobView: ("jobs", JobView, "job {0.id} ({0.kind})"),
}


def _address(work: Any) -> tuple[str, type[BaseModel], str]:
    """The path of a resource, its kind and what to call it."""
    if isinstance(work, AnalysisView):
        # Each kind has its own view, whose `kind` says what it is.
        return at("analyses", work.id), type(work), f"the {getattr(work, 'kind', 'analysis').replace('_', ' ')}"
    for ending, (segment, kind, words) in _FOLLOWED.items():
        if isinstance(work, ending):
            return at(segment, work.id), kind, words.format(work)
    raise ValueError(f"nothing to wait for: {type(work).__name__}")
