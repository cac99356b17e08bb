"""Clients that behave as real ones: whatever happens, the same request with the same key until it is acknowledged."""

from __future__ import annotations

import hashlib
import time
from itertools import count
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx

from apexcal.documents.marking import MarkView
from apexcal.documents.recordings import RecordingSummary
from apexcal.errors import ApiError, UnreachableError
from apexcal.resources.calibrations import Calibrations, CorrespondenceSets
from apexcal.resources.detections import DetectionRuns
from apexcal.resources.fleets import Fleets, Vehicles
from apexcal.resources.marking import Marking
from apexcal.resources.recordings import Recordings
from apexcal.transport import Document, HttpTransport
from benchmarks.campaign.ledger import Ledger
from benchmarks.campaign.requests import CALIBRATIONS, REGION_OF_WALKS
from tests.faults.jobs import LEVEL_RIG, Walk, pairs

_PAUSE_S = 0.3


class GaveUpError(Exception):
    """The campaign is over, and this request was never acknowledged."""


class Insistent(HttpTransport):
    """A transport that outlasts any outage. A creation's key is in its headers, so every repetition carries it."""

    def __init__(self, url: str, token: str, ledger: Ledger, until: float) -> None:
        super().__init__(url, token, pauses_s=())
        self._ledger = ledger
        self._until = until

    def send(self, method: str, path: str, **request: Any) -> httpx.Response:
        """One request, sent until the service has answered it, and not with a fault of its own."""
        while True:
            try:
                answer = super().send(method, path, **request)
            except UnreachableError:
                self._ledger.count_answer("no answer")
            except ApiError as error:
                self._ledger.count_answer(f"{error.status} {error.code}")
                if error.status < 500:
                    raise
            else:
                if "/parts/" in path and (method == "PUT" or path.endswith("/arrival")):
                    self._note_part(path, answer.json())
                return answer
            if time.monotonic() > self._until:
                raise GaveUpError(f"{method} {path}")
            time.sleep(_PAUSE_S)

    def _note_part(self, path: str, part: Document) -> None:
        recording_id = UUID(path.split("/")[2])
        with self._ledger.lock:
            self._ledger.parts[recording_id, int(part["number"])] = str(part["sha256"])


class Engineer:
    """Asks for calibrations, uploads recordings and has vertices detected in them. Safe to share between threads."""

    def __init__(self, url: str, token: str, ledger: Ledger, until: float) -> None:
        self._http = Insistent(url, token, ledger, until)
        self._ledger = ledger
        self._until = until
        self._pairs = pairs()
        self._numbers = count()
        self.fleets = [Fleets(self._http).create(f"fleet {number}").id for number in range(3)]

    def calibrate(self, kind: str) -> UUID:
        """Ask for one calibration of a new vehicle, from nothing."""
        vehicle, rig = self._rig(LEVEL_RIG)
        made = CorrespondenceSets(self._http).import_pairs(rig, "front", self._pairs)
        with self._ledger.lock:
            self._ledger.sets.add(made.id)
        asked = Calibrations(self._http).create(vehicle, [made.id], **CALIBRATIONS[kind])
        with self._ledger.lock:
            self._ledger.calibrations[asked.id] = kind
        return asked.id

    def upload(self, name: str, walk: Walk) -> UUID:
        """Upload a recording, wait until it is ready, and have its vertices detected."""
        vehicle, rig = self._rig(walk.rig)
        recordings = Recordings(self._http)
        row: RecordingSummary = recordings.create(vehicle, rig, name, walk.bag.name)
        recording_id = row.id
        with self._ledger.lock:
            self._ledger.recordings[recording_id] = name
        while True:
            try:
                row = recordings.resume(row, walk.bag)
                break
            except UnreachableError:  # the store itself, where parts go straight into it
                self._ledger.count_answer("no answer of the store")
                time.sleep(_PAUSE_S)
        with self._ledger.lock:
            self._ledger.completed[recording_id] = _sha256(walk.bag)
        while row.state not in ("ready", "failed"):
            if time.monotonic() > self._until:
                raise GaveUpError(f"recording {recording_id} is {row.state}")
            time.sleep(_PAUSE_S)
            row = recordings.get(row.id)
        if row.state == "ready":
            found = DetectionRuns(self._http).create(row.id, REGION_OF_WALKS, detector="tolerant")
            with self._ledger.lock:
                self._ledger.detections[found.id] = name
        return recording_id

    def frames(self, recording_id: UUID) -> int:
        """How many frames a recording's camera has."""
        return len(list(Recordings(self._http).frames(recording_id, "front")))

    def _rig(self, rig: Document) -> tuple[UUID, UUID]:
        number = next(self._numbers)
        vehicle = Vehicles(self._http).create(self.fleets[number % len(self.fleets)], f"vehicle {number}")
        with self._ledger.lock:
            self._ledger.vehicles.add(vehicle.id)
        made = Vehicles(self._http).create_rig(vehicle.id, rig)
        with self._ledger.lock:
            self._ledger.rigs.add(made.id)
        return vehicle.id, made.id


class Annotator:
    """Marks frames, and corrects itself now and then."""

    def __init__(self, person_id: UUID, url: str, token: str, ledger: Ledger, until: float) -> None:
        self._marking = Marking(Insistent(url, token, ledger, until))
        self._ledger = ledger
        self._person_id = person_id

    def mark(self, recording_id: UUID, frame: int, u: float, v: float, corrected: bool) -> None:
        """Mark a frame; ``corrected``: and then move the mark by half a pixel."""
        said = self._marking.put_mark(recording_id, "front", frame, u, v)
        self._note(recording_id, frame, said)
        if corrected:
            said = self._marking.put_mark(recording_id, "front", frame, u + 0.5, v, version=said.version)
            self._note(recording_id, frame, said)

    def _note(self, recording_id: UUID, frame: int, said: MarkView) -> None:
        with self._ledger.lock:
            self._ledger.marks[self._person_id, recording_id, frame] = (said.u, said.v, said.version)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
