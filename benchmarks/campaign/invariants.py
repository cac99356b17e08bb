"""Every promise, looked at in the rows: what was acknowledged is there, once, ended, and with the right bits."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any
from uuid import UUID

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from benchmarks.campaign.ledger import Ledger
from benchmarks.campaign.objects import check_objects, missing_objects
from benchmarks.campaign.requests import CALIBRATIONS, Expected, sensors, sha256_of, vertices
from service.platform.db.base import Base
from service.platform.db.models import (
    Answer,
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Detection,
    Job,
    Publication,
    Recording,
    Result,
    Rig,
    Slot,
    UploadPart,
    Vehicle,
)
from service.platform.storage.store import Store
from tests.faults.results import documents

_UNENDED = ("queued", "running", "ingesting")


@dataclass
class Findings:
    """Broken promises, in sentences. All five lists are empty where every promise was kept."""

    lost: list[str] = field(default_factory=list[str])
    doubled: list[str] = field(default_factory=list[str])
    different_bits: list[str] = field(default_factory=list[str])
    stuck: list[str] = field(default_factory=list[str])
    orphans: list[str] = field(default_factory=list[str])

    def by_kind(self) -> dict[str, list[str]]:
        """The lists by their names."""
        return vars(self)


def check(session: Session, store: Store, keys: Iterable[str], ledger: Ledger, expected: Expected) -> Findings:
    """Look at everything; ``keys`` are the objects that the store holds."""
    found = Findings()
    present = set(keys)
    found.stuck += [f"never answered: {what}" for what in ledger.never_answered]
    _check_rows(session, ledger, found)
    _check_calibrations(session, ledger, expected, found)
    _check_marks(session, ledger, found)
    _check_jobs(session, found)
    found.orphans += check_objects(session, present)
    found.lost += missing_objects(session, present)
    _check_uploads(session, store, present, ledger, expected, found)
    _check_detections(session, ledger, expected, found)
    return found


def _check_rows(session: Session, ledger: Ledger, found: Findings) -> None:
    """What was acknowledged is there, and nothing else is: a repeated request made nothing twice."""
    known: list[tuple[type[Base], Any, Iterable[UUID]]] = [
        (Vehicle, Vehicle.id, ledger.vehicles),
        (Rig, Rig.id, ledger.rigs),
        (CorrespondenceSet, CorrespondenceSet.id, ledger.sets),
        (Calibration, Calibration.id, ledger.calibrations),
        (Recording, Recording.id, ledger.recordings),
        (Detection, Detection.id, ledger.detections),
    ]
    for table, column, acknowledged in known:
        there, wanted = set(session.scalars(select(column))), set(acknowledged)
        found.lost += [f"{table.__tablename__} {one} was acknowledged and is not there" for one in wanted - there]
        found.doubled += [f"{table.__tablename__} {one} was never acknowledged" for one in there - wanted]


def _check_calibrations(session: Session, ledger: Ledger, expected: Expected, found: Findings) -> None:
    for row in session.scalars(select(Calibration)):
        kind = ledger.calibrations.get(row.id)
        what = f"calibration {row.id} ({kind})"
        if row.state in _UNENDED:
            found.stuck.append(f"{what} is {row.state}, {row.remaining} runs remain")
            continue
        if row.remaining != 0:
            found.doubled.append(f"{what} has ended with {row.remaining} runs remaining")
        if row.state != "done":
            found.lost.append(f"{what} is {row.state}: {row.problem}")
            continue
        if kind is not None and documents(session, row.id) != expected.calibrations[kind]:
            found.different_bits.append(f"{what} found other bits than the undisturbed one")
        given = session.scalar(
            select(func.count()).select_from(Publication).join(Result).where(Result.calibration_id == row.id)
        )
        if kind is not None and given != (CALIBRATIONS[kind].get("publish") == "recommended"):
            found.doubled.append(f"{what} was published {given} times")
    for run in session.scalars(select(CalibrationRun)):
        _check_run(session, run, found)


def _check_run(session: Session, run: CalibrationRun, found: Findings) -> None:
    what = f"run {run.id} of calibration {run.calibration_id}"
    if run.state in _UNENDED:
        found.stuck.append(f"{what} is {run.state} in iteration {run.iteration}, {run.remaining} bundles remain")
        return
    if run.remaining != 0:
        found.doubled.append(f"{what} has ended with {run.remaining} bundles remaining")
    if run.state != "done":
        return
    results = session.scalar(select(func.count()).where(Result.run_id == run.id)) or 0
    if results != 1:
        (found.doubled if results else found.lost).append(f"{what} has {results} results")
    slots = Counter(
        (i, s) for i, s in session.execute(select(Slot.iteration, Slot.slot).where(Slot.run_id == run.id))
    )
    wanted = {(iteration, slot) for iteration in range(run.iteration) for slot in range(run.slots)}
    found.lost += [f"{what} has no slot {slot}" for slot in wanted - set(slots)]
    found.doubled += [f"{what} has slot {slot} {slots[slot]} times" for slot in slots if slots[slot] > 1]
    found.doubled += [f"{what} has the slot {slot}, which it never began" for slot in set(slots) - wanted]


def _check_marks(session: Session, ledger: Ledger, found: Findings) -> None:
    versions: dict[tuple[UUID, UUID, int], list[int]] = defaultdict(list)
    there: dict[tuple[UUID, UUID, int], Answer] = {}
    for row in session.scalars(select(Answer).order_by(Answer.version)):
        key = (row.person_id, row.recording_id, row.frame_index)
        versions[key].append(row.version)
        if row.is_mark:
            there[key] = row
    for key, acknowledged in ledger.marks.items():
        mark = there.pop(key, None)
        said = None if mark is None else (mark.u, mark.v, mark.version)
        if said != acknowledged:
            found.lost.append(f"the mark {key} was acknowledged as {acknowledged} and is {said}")
        if mark is None:
            continue
        if versions[key] != list(range(1, mark.version + 1)):
            found.doubled.append(f"the mark {key} of version {mark.version} has the versions {versions[key]}")
    found.doubled += [f"the mark {key} was never acknowledged" for key in there]


def _check_jobs(session: Session, found: Findings) -> None:
    done: Counter[tuple[Any, ...]] = Counter()
    for job in session.scalars(select(Job)):
        if job.state in _UNENDED:
            found.stuck.append(f"job {job.id} ({job.kind} {job.payload}) is {job.state}, attempt {job.attempt}")
        elif job.kind == "precision":
            continue  # it is asked anew as marks come, and chance marks may not determine a mount
        elif job.state != "done":
            found.lost.append(f"job {job.id} ({job.kind} {job.payload}) is {job.state}: {job.problem}")
        done[job.kind, job.subject_id, repr(job.payload)] += 1
    found.doubled += [f"{times} jobs for {work}" for work, times in done.items() if times > 1]


def _check_uploads(
    session: Session, store: Store, present: set[str], ledger: Ledger, expected: Expected, found: Findings
) -> None:
    parts: dict[UUID, list[UploadPart]] = {}
    for part in session.scalars(select(UploadPart).order_by(UploadPart.recording_id, UploadPart.number)):
        parts.setdefault(part.recording_id, []).append(part)
    for (recording_id, number), sha256 in ledger.parts.items():
        if sha256 not in [part.sha256 for part in parts.get(recording_id, []) if part.number == number]:
            found.lost.append(f"part {number} of recording {recording_id} was acknowledged and is not there")
    for recording_id, sha256 in ledger.completed.items():
        row = session.get(Recording, recording_id)
        what = f"recording {recording_id}"
        if row is None:
            continue  # said above
        if row.state != "ready":
            kind = found.stuck if row.state in _UNENDED else found.lost
            kind.append(f"{what} is {row.state}: {row.problem}")
        keys = [part.blob_key for part in parts.get(recording_id, [])]
        if not present.issuperset(keys):
            continue  # said above
        if sha256_of(store, keys) != sha256:
            found.different_bits.append(f"{what}: the original has other bytes than were sent")
        if row.state == "ready" and sensors(session, store, row) != expected.recordings[ledger.recordings[row.id]]:
            found.different_bits.append(f"{what}: its sensors differ from the undisturbed ones")


def _check_detections(session: Session, ledger: Ledger, expected: Expected, found: Findings) -> None:
    for row in session.scalars(select(Detection)):
        what = f"detection {row.id}"
        if row.state in _UNENDED:
            found.stuck.append(f"{what} is {row.state}, {row.remaining} shards remain")
            continue
        if row.remaining != 0:
            found.doubled.append(f"{what} has ended with {row.remaining} shards remaining")
        if row.state != "done":
            found.lost.append(f"{what} is {row.state}: {row.problem}")
        elif row.id in ledger.detections and vertices(session, row) != expected.detections[ledger.detections[row.id]]:
            found.different_bits.append(f"{what} found other vertices than the undisturbed one")
