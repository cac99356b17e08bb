"""An operator's second chance for failed work: its subject goes back to where it began, with fresh jobs.

One transaction. The failed job stays as it is, with its history; results are those that a first try would have had.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from uuid import UUID

from sqlalchemy import delete, exists, select, update
from sqlalchemy.orm import Session

from service.broker.hints import hint
from service.calibration_runs.actions import start_runs
from service.db.calibrations import Calibration, CalibrationRun, Result, Slot
from service.db.detections import Detection, Vertex
from service.db.fleet_requests import FleetRequestVehicle
from service.db.jobs import Job
from service.db.recordings import Recording
from service.db.studies import Study
from service.jobs.history import note
from service.jobs.queue import enqueue, enqueue_all


class CannotRequeueError(Exception):
    """Why this job's work is not started again."""


def requeue(session: Session, job_id: int) -> Sequence[Job]:
    """Start a failed job's work anew and return the fresh jobs. Raises :class:`CannotRequeueError`."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is None:
        raise CannotRequeueError(f"there is no job {job_id}")
    if job.state != "failed":
        raise CannotRequeueError(f"job {job_id} is {job.state}; only failed ones are started again")
    again = _AGAIN.get(job.kind)
    if again is None:
        raise CannotRequeueError(f"work of the kind {job.kind} is not started again by itself; ask for it anew")
    under_way = exists().where(Job.subject_id == job.subject_id, Job.state.in_(("queued", "running")))
    if session.scalar(select(under_way)):
        raise CannotRequeueError("other jobs of the same work are under way; wait for their end")
    fresh = again(session, job)
    note(session, job, "requeued", job.problem)
    return fresh


def _recording(session: Session, job: Job) -> Sequence[Job]:
    row = session.get(Recording, job.subject_id, with_for_update=True)
    if row is None or row.state != "failed":
        raise CannotRequeueError(f"its recording is {row.state if row else 'deleted'}, no longer failed")
    fresh = enqueue(session, kind="ingest", fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = "queued", None, fresh.id
    row.version += 1
    hint(session, row.fleet_id, "recording", row.id)
    return [fresh]


def _study(session: Session, job: Job) -> Sequence[Job]:
    row = session.get(Study, job.subject_id, with_for_update=True)
    if row is None or row.state != "failed":
        raise CannotRequeueError(f"its study is {row.state if row else 'deleted'}, no longer failed")
    fresh = enqueue(session, kind=job.kind, fleet_id=row.fleet_id, subject_id=row.id)
    row.state, row.problem, row.job_id = "queued", None, fresh.id
    hint(session, row.fleet_id, "recording", row.recording_id)
    return [fresh]


def _detection(session: Session, job: Job) -> Sequence[Job]:
    """All shards again: a failed one ended the run, and what the others found later was dropped."""
    row = session.get(Detection, job.subject_id, with_for_update=True)
    if row is None or row.state != "failed":
        raise CannotRequeueError(f"its detection is {row.state if row else 'deleted'}, no longer failed")
    shards = {
        payload.get("first", 0): payload
        for payload in session.scalars(select(Job.payload).where(Job.subject_id == row.id, Job.kind == "detect"))
    }
    session.execute(delete(Vertex).where(Vertex.detection_id == row.id))
    row.state, row.problem, row.finished_at = "queued", None, None
    row.remaining, row.counts = len(shards), {}
    session.flush()
    hint(session, row.fleet_id, "detection", row.id)
    payloads = [shards[first] for first in sorted(shards)]
    return enqueue_all(session, kind="detect", fleet_id=row.fleet_id, subject_id=row.id, payloads=payloads)


def _run(session: Session, job: Job) -> Sequence[Job]:
    """The whole run again, from its first iteration; its calibration waits for it."""
    run = session.get(CalibrationRun, job.subject_id, with_for_update=True)
    if run is None or run.state != "failed":
        raise CannotRequeueError(f"its run is {run.state if run else 'deleted'}, no longer failed")
    if session.scalar(select(exists().where(FleetRequestVehicle.calibration_id == run.calibration_id))):
        raise CannotRequeueError("it belongs to a fleet request; retry the failed vehicles there")
    for table in (Slot, Result):
        session.execute(delete(table).where(table.run_id == run.id).execution_options(synchronize_session=False))
    run.state, run.failure, run.finished_at = "queued", None, None
    run.schedule, run.iteration, run.remaining = None, 0, 0
    session.flush()
    _reopen(session, run.calibration_id)
    before = _newest_job(session, run.id)
    start_runs(session, [run])
    hint(session, run.fleet_id, "calibration", run.calibration_id)
    return session.scalars(select(Job).where(Job.subject_id == run.id, Job.id > before).order_by(Job.id)).all()


def _reopen(session: Session, calibration_id: UUID) -> None:
    reopened = session.execute(
        update(Calibration)
        .where(Calibration.id == calibration_id, Calibration.state != "cancelled")
        .values(remaining=Calibration.remaining + 1, state="running", finished_at=None, summary=None, problem=None)
        .returning(Calibration.id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if reopened is None:
        raise CannotRequeueError("its calibration was cancelled; ask for a new one")
    # The calibration is locked now, so none begins meanwhile: it would end the calibration without this run.
    comparison = exists().where(Job.subject_id == calibration_id, Job.state.in_(("queued", "running")))
    if session.scalar(select(comparison)):
        raise CannotRequeueError("the cameras of its calibration are being compared; wait for their end")


def _newest_job(session: Session, subject_id: UUID) -> int:
    return session.scalar(select(Job.id).where(Job.subject_id == subject_id).order_by(Job.id.desc()).limit(1)) or 0


_AGAIN: dict[str, Callable[[Session, Job], Sequence[Job]]] = {
    "ingest": _recording,
    "preview": _study,
    "suggestion": _study,
    "clock_offset": _study,
    "detect": _detection,
    "solve": _run,
}
