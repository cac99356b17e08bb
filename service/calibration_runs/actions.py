"""State transitions of runs: iterations as bundles of slots, the fan-in, the end of run and request.

Every function here works inside the caller's transaction. Locks are taken in one order: job, run, calibration, then
those of :mod:`service.calibration_runs.conclusion`.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Protocol
from uuid import UUID

from sqlalchemy import bindparam, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.calibration_runs.conclusion import end_calibration
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun, Result, Slot
from service.platform.db.clock import now
from service.platform.handovers import Conclusion, RunEnd, SlotBundle
from service.platform.jobs.bundles import cut
from service.platform.jobs.claims import StaleInputError
from service.platform.jobs.queue import enqueue, enqueue_all, enqueue_each

# Built once, as those of :mod:`service.platform.jobs.claims`.
_COUNT_DOWN = (
    update(CalibrationRun)
    .where(CalibrationRun.id == bindparam("run"), CalibrationRun.state.in_(UNENDED))
    .values(remaining=CalibrationRun.remaining - 1, state=WorkState.RUNNING)
    .returning(CalibrationRun.remaining)
)
_END_RUN = (
    update(CalibrationRun)
    .where(CalibrationRun.id == bindparam("run"), CalibrationRun.state.in_(UNENDED))
    .values(state=bindparam("ended_as"), failure=bindparam("because"), finished_at=now())
    .returning(CalibrationRun.id)
)
_END_WHOLE_RUN = _END_RUN.values(search_state=bindparam("search"), iteration=bindparam("iterations"))
_COUNT_RUN = (
    update(Calibration)
    .where(Calibration.id == bindparam("calibration"), Calibration.state.in_(UNENDED))
    .values(remaining=Calibration.remaining - 1, state=WorkState.RUNNING)
    .returning(Calibration.remaining)
)
_RUNS = select(CalibrationRun.fold, CalibrationRun.state, CalibrationRun.failure).where(
    CalibrationRun.calibration_id == bindparam("calibration")
)
_ENDED = select(CalibrationRun.id, CalibrationRun.finished_at).where(
    CalibrationRun.calibration_id == bindparam("calibration"), CalibrationRun.id != bindparam("run")
)


class Conclude(Protocol):
    """Stores what a worker concluded of a calibration, and the result of its last run, and ends it.

    Raises :class:`StaleInputError`, with nothing written, if it was judged beside other results than are current.
    """

    def __call__(
        self, session: Session, calibration_id: UUID, conclusion: Conclusion, fresh: Result | None = None
    ) -> None: ...


def start_runs(session: Session, runs: Sequence[CalibrationRun]) -> None:
    """Insert the first work of runs of one fleet: the whole run as one job, or the bundles of its first iteration."""
    work = [
        (run.id, payload) for run in runs for payload in ([{"part": "run"}] if run.farm == "runs" else _bundles(run))
    ]
    enqueue_each(session, kind="solve", fleet_id=runs[0].fleet_id, work=work)


def start_iteration(session: Session, run: CalibrationRun) -> None:
    """Insert the bundles of the run's next iteration."""
    enqueue_all(session, kind="solve", fleet_id=run.fleet_id, subject_id=run.id, payloads=_bundles(run))


def _bundles(run: CalibrationRun) -> list[Json]:
    """The running iteration's bundles, counted. They become fixed rows, never cut anew on a retry."""
    bundles = cut(run.slots, run.bundle)
    run.remaining = len(bundles)
    return [
        {"part": "slots", "iteration": run.iteration, "first": bundle.start, "stop": bundle.stop}
        for bundle in bundles
    ]


def start_finish(session: Session, run: CalibrationRun) -> None:
    """Insert the run's last job: polish, baselines and held-out pairs."""
    enqueue(session, kind="solve", fleet_id=run.fleet_id, subject_id=run.id, payload={"part": "finish"})


def count_down(session: Session, run_id: UUID) -> CalibrationRun | None:
    """Take one bundle off the running iteration. The caller who takes the last one gets the run, and goes on with it.

    The row stays locked until the commit, so of two that finish at the same moment the second sees the first.
    """
    if session.connection().execute(_COUNT_DOWN, {"run": run_id}).scalar_one_or_none() != 0:
        return None
    return session.get_one(CalibrationRun, run_id, populate_existing=True)


def go_on(session: Session, run_id: UUID, bundle: SlotBundle) -> None:
    """Take a bundle off its iteration; after the last narrow the bounds about the best slots, and go on or stop."""
    run = count_down(session, run_id)
    if run is None:
        return
    of_iteration = select(Slot).where(Slot.run_id == run.id, Slot.iteration == run.iteration).order_by(Slot.slot)
    run.search_state, has_stopped = bundle.narrow(run.search_state, session.scalars(of_iteration).all())
    run.iteration += 1
    session.flush()
    if run.cancel_requested:
        end_run(session, run, WorkState.CANCELLED)
    elif has_stopped:
        start_finish(session, run)
    else:
        start_iteration(session, run)


def end_run(session: Session, run: Any, state: WorkState, failure: Json | None = None) -> None:
    """End a run once; after the calibration's last one a job concludes the calibration.

    ``run`` has its ``id``, ``fleet_id`` and ``calibration_id``: a row, or those columns of it.
    """
    ended = {"run": run.id, "ended_as": state, "because": failure}
    if session.connection().execute(_END_RUN, ended).one_or_none() is not None and _count_run(session, run):
        _end_runs(session, run.calibration_id)


def end_solved(session: Session, end: RunEnd, conclude: Conclude) -> None:
    """End a run once with its result. The calibration's last one also ends the calibration.

    Where another run ended meanwhile, or another result was published, a job concludes instead.
    """
    run, statement = end.run, _END_RUN
    ended: dict[str, Any] = {"run": run.id, "ended_as": WorkState.DONE, "because": None}
    if end.search:
        statement = _END_WHOLE_RUN
        ended |= {"search": end.search[0], "iterations": end.search[1]}
    if session.connection().execute(statement, ended).one_or_none() is None:
        return
    is_last, result = _count_run(session, run), Result(**end.result)
    if is_last and end.conclusion and (not end.ended or _still_ended(session, run) == end.ended):
        try:
            conclude(session, run.calibration_id, end.conclusion, result)
            return
        except StaleInputError:
            pass
    session.add(result)
    session.flush()
    if is_last:
        _end_runs(session, run.calibration_id)


def _count_run(session: Session, run: Any) -> bool:
    """Take an ended run off its calibration, whose row is locked then; whether it was the last."""
    hint(session, run.fleet_id, "calibration", run.calibration_id)
    remaining = session.connection().execute(_COUNT_RUN, {"calibration": run.calibration_id})
    return remaining.scalar_one_or_none() == 0


def _still_ended(session: Session, run: Any) -> dict[UUID, datetime]:
    others = session.connection().execute(_ENDED, {"calibration": run.calibration_id, "run": run.id})
    return {other.id: other.finished_at for other in others}


def _end_runs(session: Session, calibration_id: UUID) -> None:
    """Have a worker judge what the runs found. Without a fit to all pairs, or cancelled, the calibration ends now."""
    # As they stand in the database, whatever this session has loaded of them.
    calibration = session.get_one(Calibration, calibration_id, populate_existing=True)
    runs = session.connection().execute(_RUNS, {"calibration": calibration.id}).all()
    problem = next((run.failure for run in runs if run.failure), None)
    if any(run.state == WorkState.CANCELLED for run in runs):
        end_calibration(session, calibration, WorkState.CANCELLED, problem)
    elif any(run.fold == FULL and run.state == WorkState.DONE for run in runs):
        enqueue(session, kind="conclude", fleet_id=calibration.fleet_id, subject_id=calibration.id)
    else:
        end_calibration(session, calibration, WorkState.FAILED, problem)
