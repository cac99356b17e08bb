"""A small database and store in which every promise was kept, for tests that break one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.ids import new_id
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
    fleet, person = Fleet(id=new_id(), name="fleet"), Person(id=new_id(), name="annotator")
    session.add_all([fleet, person])
    session.flush()
    vehicle = Vehicle(id=new_id(), fleet_id=fleet.id, name="car")
    session.add(vehicle)
    session.flush()
    rig = Rig(id=new_id(), fleet_id=fleet.id, vehicle_id=vehicle.id, name="roof", lidar_frame="velodyne")
    session.add(rig)
    session.flush()
    common: dict[str, Any] = {"fleet_id": fleet.id, "vehicle_id": vehicle.id, "rig_id": rig.id}
    ledger.vehicles.add(vehicle.id)
    ledger.rigs.add(rig.id)
    calibration, run = _calibration(session, common, ledger)
    recording, part_key = _recording(session, store, common, ledger)
    _mark(session, recording, person, ledger)
    detection = Detection(
        id=new_id(),
        fleet_id=fleet.id,
        recording_id=recording.id,
        region={},
        detector="tolerant",
        options={},
        pairing={},
        content_hash="0",
        state="done",
        remaining=0,
        counts={"vertices": 0},
    )
    session.add(detection)
    ledger.detections[detection.id] = WALK
    session.add(_done(fleet.id, "detect", detection.id, {}))
    session.flush()
    expected.calibrations[KIND] = documents(session, calibration.id)
    expected.recordings[WALK] = sensors(session, store, recording)
    expected.detections[WALK] = vertices(session, detection)
    return World(session, store, ledger, expected, calibration.id, run.id, recording.id, part_key)


def _calibration(session: Session, common: dict[str, Any], ledger: Ledger) -> tuple[Calibration, CalibrationRun]:
    pairs = CorrespondenceSet(
        id=new_id(), **common, camera="front", source="import", content_hash="0", count=0, pairs={}
    )
    calibration = Calibration(
        id=new_id(), **common, request={}, content_hash="0", remaining=0, publish="none", state="done"
    )
    session.add_all([pairs, calibration])
    session.flush()
    run = CalibrationRun(
        id=new_id(),
        fleet_id=common["fleet_id"],
        calibration_id=calibration.id,
        set_id=pairs.id,
        camera="front",
        model="pinhole",
        fold=-1,
        farm="runs",
        slots=2,
        bundle=2,
        problem={},
        state="done",
        iteration=2,
        remaining=0,
    )
    session.add(run)
    session.flush()
    of_slots = {"loss": 1.0, "parameters": [0.0], "evaluations": 1, "seconds": 0.1, "worker": "w"}
    session.add_all([Slot(run_id=run.id, iteration=i, slot=s, **of_slots) for i in range(2) for s in range(2)])
    of_run = {"fleet_id": run.fleet_id, "calibration_id": calibration.id, "run_id": run.id}
    session.add(Result(**of_run, camera="front", model="pinhole", fold=-1, document={"rms_px": 1.0}))
    session.add(_done(run.fleet_id, "solve", run.id, {"part": "run"}))
    ledger.sets.add(pairs.id)
    ledger.calibrations[calibration.id] = KIND
    return calibration, run


def _recording(session: Session, store: Store, common: dict[str, Any], ledger: Ledger) -> tuple[Recording, str]:
    recording = Recording(id=new_id(), **common, name="drive", file_name="drive.bag", state="ready", facts={})
    session.add(recording)
    session.flush()
    keys = [f"recordings/{recording.id}/{name}" for name in ("parts/1", "sensors/front.mcap")]
    for key in keys:
        store.put_bytes(key, b"bytes")
        session.add(Blob(key=key, state="stored", size=5))
    session.flush()
    digest = hashlib.sha256(b"bytes").hexdigest()
    session.add(UploadPart(recording_id=recording.id, number=1, blob_key=keys[0], size=5, sha256=digest))
    of_sensor = {"topic": "/front", "frame_id": "front", "count": 1, "first_ns": 0, "last_ns": 0, "facts": {}}
    camera = Sensor(
        id=new_id(), recording_id=recording.id, kind="camera", name="front", blob_key=keys[1], **of_sensor
    )
    session.add(camera)
    session.flush()
    of_frame = {"stamp_ns": 0, "offset": 0, "length": 5, "media_type": "image/png", "width": 960, "height": 600}
    session.add(CameraFrame(sensor_id=camera.id, index=0, **of_frame))
    session.add(_done(recording.fleet_id, "ingest", recording.id, {}))
    ledger.recordings[recording.id] = WALK
    ledger.parts[recording.id, 1] = ledger.completed[recording.id] = digest
    return recording, keys[0]


def _mark(session: Session, recording: Recording, person: Person, ledger: Ledger) -> None:
    session.flush()
    camera = session.scalars(select(Sensor).where(Sensor.recording_id == recording.id)).one()
    whose = {"recording_id": recording.id, "person_id": person.id, "sensor_id": camera.id, "frame_index": 0}
    session.add(Answer(**whose, u=10.0, v=20.0, is_mark=True, version=1))
    ledger.marks[person.id, recording.id, 0] = (10.0, 20.0, 1)


def _done(fleet_id: UUID, kind: str, subject_id: UUID, payload: dict[str, Any]) -> Job:
    return Job(
        fleet_id=fleet_id,
        kind=kind,
        queue="solve",
        subject_id=subject_id,
        payload=payload,
        state="done",
        attempt=1,
    )
