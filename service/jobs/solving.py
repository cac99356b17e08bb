"""How a calibration's runs move: iterations as bundles of slots, the fan-in, and the end of run and request.

Every function here works inside the caller's transaction. Locks are taken in one order: job, run, calibration.
"""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import update
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.calibrations import Calibration, CalibrationRun
from service.db.clock import utc_now
from service.events.hints import hint
from service.jobs.bundles import cut
from service.jobs.conclusion import conclude
from service.jobs.queue import enqueue, enqueue_all

_UNENDED = ("queued", "running")


def start_run(session: Session, run: CalibrationRun) -> None:
    """Insert a run's first work: the whole run as one job, or the bundles of its first iteration."""
    if run.farm == "runs":
        _enqueue_part(session, run, {"part": "run"})
    else:
        start_iteration(session, run)


def start_iteration(session: Session, run: CalibrationRun) -> None:
    """Insert the bundles of the run's next iteration. They are fixed rows, never cut anew on a retry."""
    bundles = cut(run.slots, run.bundle)
    run.remaining = len(bundles)
    payloads = [
        {"part": "slots", "iteration": run.iteration, "first": bundle.start, "stop": bundle.stop}
        for bundle in bundles
    ]
    enqueue_all(session, kind="solve", fleet_id=run.fleet_id, subject_id=run.id, payloads=payloads)


def start_finish(session: Session, run: CalibrationRun) -> None:
    """Insert the run's last job: polish, baselines and held-out pairs."""
    _enqueue_part(session, run, {"part": "finish"})


def count_down(session: Session, run_id: UUID) -> CalibrationRun | None:
    """Take one bundle off the running iteration. The caller who takes the last one gets the run, and goes on with it.

    The row stays locked until the commit, so of two that finish at the same moment the second sees the first.
    """
    left = session.execute(
        update(CalibrationRun)
        .where(CalibrationRun.id == run_id, CalibrationRun.state.in_(_UNENDED))
        .values(remaining=CalibrationRun.remaining - 1, state="running")
        .returning(CalibrationRun.remaining)
        .execution_options(synchronize_session=False)
    ).scalar_one_or_none()
    if left != 0:
        return None
    return session.get_one(CalibrationRun, run_id, populate_existing=True)


def end_run(session: Session, run: CalibrationRun, state: str, failure: Json | None = None) -> None:
    """End a run once; the calibration's last one ends the calibration too."""
    ended = session.execute(
        update(CalibrationRun)
        .where(CalibrationRun.id == run.id, CalibrationRun.state.in_(_UNENDED))
        .values(state=state, failure=failure, finished_at=utc_now())
        .returning(CalibrationRun.id)
        .execution_options(synchronize_session=False)
    ).one_or_none()
    if ended is None:
        return
    left = session.execute(
        update(Calibration)
        .where(Calibration.id == run.calibration_id, Calibration.state.in_(_UNENDED))
        .values(remaining=Calibration.remaining - 1, state="running")
        .returning(Calibration.remaining)
        .execution_options(synchronize_session=False)
    ).scalar_one_or_none()
    if left == 0:
        conclude(session, session.get_one(Calibration, run.calibration_id, populate_existing=True))
    hint(session, run.fleet_id, "calibration", run.calibration_id)


def _enqueue_part(session: Session, run: CalibrationRun, payload: Json) -> None:
    enqueue(session, kind="solve", fleet_id=run.fleet_id, subject_id=run.id, payload=payload)
