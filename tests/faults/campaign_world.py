"""A small database and store in which every promise was kept, for tests that break one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from itertools import product
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.models import (
    Answer,
    Blob,
    Calibration,
    CalibrationRun,
    CameraFrame,
    CorrespondenceSet,
    Detection,
    Fleet,
    Job,
    Person,
    Recording,
    Result,
    Rig,
    Sensor,
    Slot,
    UploadPart,
    Vehicle,
)
from service.platform.storage.store import Store
from tests.faults.campaign.invariants import Findings, check
from tests.faults.campaign.ledger import Ledger
from tests.faults.campaign.requests import Expected, sensors, vertices
from tests.faults.results import documents
from tests.support.rows import add

KIND, WALK = "pinhole by slots", "walk-0"


@dataclass
class World:
    """One calibration, one recording with its detection, one mark."""

    session: Session
    store: Store
    ledger: Ledger
    expected: Expected
    calibration_id: UUID
    run_id: UUID
    recording_id: UUID
    part_key: str

    def findings(self) -> Findings:
        """What the check says now."""
        self.session.flush()
        self.session.expire_all()
        keys = [one.key for one in self.store.list()]
        return check(self.session, self.store, keys, self.ledger, self.expected)


def make_world(session: Session, store: Store) -> World:
    """Everything as the service leaves it after undisturbed work."""
    ledger, expected = Ledger(), Expected()
    fleet, person = add(session, Fleet, name="fleet"), add(session, Person, name="annotator")
    vehicle = add(session, Vehicle, fleet)
    rig = add(session, Rig, vehicle)
    ledger.vehicles.add(vehicle.id)
    ledger.rigs.add(rig.id)
    calibration, run = _calibration(session, rig, ledger)
    recording, part_key = _recording(session, store, rig, ledger)
    _mark(session, recording, person, ledger)
    detection = add(session, Detection, recording, counts={"vertices": 0})
    ledger.detections[detection.id] = WALK
    _done(session, fleet.id, "detect", detection.id)
    expected.calibrations[KIND] = documents(session, calibration.id)
    expected.recordings[WALK] = sensors(session, store, recording)
    expected.detections[WALK] = vertices(session, detection)
    return World(session, store, ledger, expected, calibration.id, run.id, recording.id, part_key)


def _calibration(session: Session, rig: Rig, ledger: Ledger) -> tuple[Calibration, CalibrationRun]:
    pairs = add(session, CorrespondenceSet, rig)
    calibration = add(session, Calibration, rig)
    run = add(session, CalibrationRun, calibration, pairs, state="done", iteration=2, remaining=0)
    for iteration, slot in product(range(2), range(2)):
        add(session, Slot, run, iteration=iteration, slot=slot)
    add(session, Result, run, document={"rms_px": 1.0})
    _done(session, run.fleet_id, "solve", run.id, part="run")
    ledger.sets.add(pairs.id)
    ledger.calibrations[calibration.id] = KIND
    return calibration, run


def _recording(session: Session, store: Store, rig: Rig, ledger: Ledger) -> tuple[Recording, str]:
    recording = add(session, Recording, rig, facts={})
    keys = [f"recordings/{recording.id}/{name}" for name in ("parts/1", "sensors/front.mcap")]
    for key in keys:
        store.put_bytes(key, b"bytes")
        add(session, Blob, key=key, size=5)
    digest = hashlib.sha256(b"bytes").hexdigest()
    add(session, UploadPart, recording, number=1, blob_key=keys[0], size=5, sha256=digest)
    add(session, CameraFrame, add(session, Sensor, recording, blob_key=keys[1]), length=5)
    _done(session, recording.fleet_id, "ingest", recording.id)
    ledger.recordings[recording.id] = WALK
    ledger.parts[recording.id, 1] = ledger.completed[recording.id] = digest
    return recording, keys[0]


def _mark(session: Session, recording: Recording, person: Person, ledger: Ledger) -> None:
    camera = session.scalars(select(Sensor).where(Sensor.recording_id == recording.id)).one()
    add(session, Answer, recording, person, camera, frame_index=0, u=10.0, v=20.0, is_mark=True, version=1)
    ledger.marks[person.id, recording.id, 0] = (10.0, 20.0, 1)


def _done(session: Session, fleet_id: UUID, kind: str, subject_id: UUID, **payload: str) -> None:
    ended = {"queue": "solve", "state": "done", "attempt": 1}
    add(session, Job, fleet_id=fleet_id, kind=kind, subject_id=subject_id, payload=payload, **ended)
