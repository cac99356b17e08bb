"""Jobs of calibrations: parts of runs, and the conclusion at the end."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import partial
from uuid import UUID

from sqlalchemy import delete, exists, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.calibration_runs.actions import Conclude, end_calibrations, end_runs, end_solved, go_on, start_runs
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CalibrationRun, Result, Slot
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.jobs import Job
from service.platform.handovers import RunEnd, SlotBundle
from service.platform.jobs.kinds import CannotRetryError, Kind, failed_subject
from service.platform.jobs.queue import enqueue


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


def _end_parts(session: Session, run_ids: Collection[UUID], state: WorkState, problem: Json | None) -> None:
    """A failed or cancelled job ends its run; a done one was taken."""
    if state != WorkState.DONE:
        end_runs(session, run_ids, state, problem)


def _end_conclusions(session: Session, ids: Collection[UUID], state: WorkState, problem: Json | None) -> None:
    """A conclusion that failed or was cancelled ends its calibration; a done one has ended it already."""
    if state != WorkState.DONE:
        end_calibrations(session, ids, state, problem)


def _retry_conclusion(session: Session, job: Job) -> Sequence[Job]:
    """The conclusion again; its runs have all ended."""
    failed_subject(session, job, Calibration, "calibration")
    _reopen(session, job.subject_id, runs=0)
    return [enqueue(session, kind="conclude", fleet_id=job.fleet_id, subject_id=job.subject_id)]


def _retry_run(session: Session, job: Job) -> Sequence[Job]:
    """The whole run again, from its first iteration; its calibration waits for it."""
    run = failed_subject(session, job, CalibrationRun, "run")
    _reopen(session, run.calibration_id, runs=1)
    for table in (Slot, Result):
        session.execute(delete(table).where(table.run_id == run.id))
    run.reopen(WorkState.QUEUED)
    run.search_state, run.iteration = None, 0
    hint(session, run.fleet_id, "calibration", run.calibration_id)
    return start_runs(session, [run])


def _reopen(session: Session, calibration_id: UUID, runs: int) -> None:
    """Take back the end of a calibration that waits for ``runs`` more runs."""
    calibration = session.get_one(Calibration, calibration_id, with_for_update=True, populate_existing=True)
    if calibration.state == WorkState.CANCELLED:
        raise CannotRetryError("its calibration was cancelled; ask for a new one")
    # The calibration is locked now, so none begins meanwhile: it would end the calibration without this run.
    if session.scalar(select(exists().where(Job.subject_id == calibration_id, Job.state.in_(UNENDED)))):
        raise CannotRetryError("its calibration is being concluded; wait for that")
    if session.scalar(select(exists().where(FleetRequestVehicle.calibration_id == calibration_id))):
        raise CannotRetryError("it belongs to a fleet request; retry the failed vehicles there")
    calibration.reopen(WorkState.RUNNING, calibration.remaining + runs)
    calibration.summary, calibration.reopened = None, calibration.reopened + 1
    session.execute(update(Result).where(Result.calibration_id == calibration_id).values(checks=None, verdict=None))


def kinds(conclude: Conclude) -> tuple[Kind, ...]:
    """Return the kinds of parts of runs and of conclusions. ``conclude`` stores what one says, and publishes."""
    return (
        Kind("solve", "solve", _end_parts, _retry_run, take=partial(_take_part, conclude), forget=_forget_slots),
        Kind("conclude", "report", _end_conclusions, _retry_conclusion, take=conclude),
    )
