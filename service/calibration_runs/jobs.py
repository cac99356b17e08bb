"""Jobs of calibrations: parts of runs, and the conclusion at the end."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
from uuid import UUID

from sqlalchemy import delete, exists, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.calibration_runs.actions import Conclude, end_run, end_solved, go_on, start_runs
from service.calibration_runs.conclusion import end_calibration
from service.platform.broker.hints import hint
from service.platform.db.base import Json, state_literal
from service.platform.db.calibrations import Calibration, CalibrationRun, Result, Slot
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.jobs import Job
from service.platform.handovers import RunEnd, SlotBundle
from service.platform.jobs.kinds import CannotRetryError, Kind, failed_subject
from service.platform.jobs.queue import enqueue

_CANCELLED_RUNS = select(CalibrationRun.id).where(
    CalibrationRun.cancel_requested, CalibrationRun.state.in_([state_literal(state) for state in UNENDED])
)


def _take_part(conclude: Conclude, session: Session, run_id: UUID, part: SlotBundle | RunEnd) -> None:
    if isinstance(part, RunEnd):
        end_solved(session, part, conclude)
    else:
        go_on(session, run_id, part)


def _forget_slots(session: Session, run_ids: Collection[UUID]) -> None:
    """Remove the slots of runs that have ended: the calibration's summary has what they came to."""
    ended = select(CalibrationRun.id).where(CalibrationRun.id.in_(run_ids), CalibrationRun.state.not_in(UNENDED))
    slots = delete(Slot).where(Slot.run_id.in_(ended))
    session.execute(slots.execution_options(synchronize_session=False))


def _end_part(session: Session, run_id: UUID, state: WorkState, problem: Json | None) -> None:
    """A failed or cancelled job ends its run; a done one was taken."""
    run = session.get(CalibrationRun, run_id) if state != WorkState.DONE else None
    if run:
        end_run(session, run, state, problem)


def _end_conclusion(session: Session, calibration_id: UUID, state: WorkState, problem: Json | None) -> None:
    """A conclusion that failed or was cancelled ends its calibration; a done one has ended it already."""
    calibration = session.get(Calibration, calibration_id) if state != WorkState.DONE else None
    if calibration and calibration.state in UNENDED:
        end_calibration(session, calibration, state, problem)


def _retry_conclusion(session: Session, job: Job) -> Sequence[Job]:
    """The conclusion again; its runs have all ended."""
    calibration = failed_subject(session, job, Calibration, "calibration")
    _check_retried_alone(session, calibration.id)
    _reopen(session, job.subject_id, runs=0)
    return [enqueue(session, kind="conclude", fleet_id=job.fleet_id, subject_id=job.subject_id)]


def _retry_run(session: Session, job: Job) -> Sequence[Job]:
    """The whole run again, from its first iteration; its calibration waits for it."""
    run = failed_subject(session, job, CalibrationRun, "run")
    _check_retried_alone(session, run.calibration_id)
    for table in (Slot, Result):
        session.execute(delete(table).where(table.run_id == run.id))
    run.state, run.failure, run.finished_at = WorkState.QUEUED, None, None
    run.search_state, run.iteration, run.remaining = None, 0, 0
    session.flush()
    _reopen(session, run.calibration_id, runs=1)
    before = _newest_job(session, run.id)
    start_runs(session, [run])
    hint(session, run.fleet_id, "calibration", run.calibration_id)
    return session.scalars(select(Job).where(Job.subject_id == run.id, Job.id > before).order_by(Job.id)).all()


def _check_retried_alone(session: Session, calibration_id: UUID) -> None:
    if session.scalar(select(exists().where(FleetRequestVehicle.calibration_id == calibration_id))):
        raise CannotRetryError("it belongs to a fleet request; retry the failed vehicles there")


def _reopen(session: Session, calibration_id: UUID, runs: int) -> None:
    """Take back the end of a calibration that waits for ``runs`` more runs."""
    reopened = session.execute(
        update(Calibration)
        .where(Calibration.id == calibration_id, Calibration.state != WorkState.CANCELLED)
        .values(
            remaining=Calibration.remaining + runs,
            state=WorkState.RUNNING,
            finished_at=None,
            summary=None,
            problem=None,
        )
        .returning(Calibration.id)
    ).one_or_none()
    if reopened is None:
        raise CannotRetryError("its calibration was cancelled; ask for a new one")
    session.execute(update(Result).where(Result.calibration_id == calibration_id).values(checks=None, verdict=None))
    # The calibration is locked now, so none begins meanwhile: it would end the calibration without this run.
    conclusion = exists().where(Job.subject_id == calibration_id, Job.state.in_(UNENDED))
    if session.scalar(select(conclusion)):
        raise CannotRetryError("its calibration is being concluded; wait for that")


def _newest_job(session: Session, subject_id: UUID) -> int:
    return session.scalar(select(Job.id).where(Job.subject_id == subject_id).order_by(Job.id.desc()).limit(1)) or 0


def kinds(conclude: Conclude) -> tuple[Kind, ...]:
    """Return the kinds of parts of runs and of conclusions. ``conclude`` stores what one says, and publishes."""
    take = partial(_take_part, conclude)
    return (
        Kind("solve", "solve", _end_part, _retry_run, None, _CANCELLED_RUNS, take=take, forget=_forget_slots),
        Kind("conclude", "report", _end_conclusion, _retry_conclusion, take=conclude),
    )
