"""A calibration's rows: one run for each camera, model and fold, with the first jobs of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED
from service.calibration_runs.actions import start_runs
from service.calibrations.plan import CalibrationPlan, FitPlan
from service.platform.db.base import state_literal
from service.platform.db.calibrations import FULL, Calibration, CalibrationRun
from service.platform.jobs.bundles import choose_farming
from service.platform.jobs.queue import cancel, live_processes


def waiting_runs(session: Session, enough: int) -> int:
    """How many runs have not ended, of all fleets; of more than ``enough`` it says just that many."""
    unended = select(CalibrationRun.id).where(CalibrationRun.state.in_([state_literal(state) for state in UNENDED]))
    return session.scalar(select(func.count()).select_from(unended.limit(enough).subquery())) or 0


def create(
    session: Session,
    plans: Sequence[CalibrationPlan],
    farm: str,
    publish: str,
    person_id: UUID | None,
    coming: int,
) -> list[Calibration]:
    """Insert calibrations of one fleet with all their runs and their first jobs, in as few statements as one takes.

    Fits to all pairs are worked on first.
    ``coming``: how many runs there will be to be worked on beside those that wait already.
    """
    workers = live_processes(session, "solve")
    waiting = waiting_runs(session, workers) + coming
    calibrations = [_calibration(plan, publish, person_id) for plan in plans]
    session.add_all(calibrations)
    session.flush()
    runs = [
        _run(calibration, fit, fold, farm, waiting, workers)
        for calibration, plan in zip(calibrations, plans, strict=True)
        for fit, fold in sorted(_runs(plan), key=lambda run: run[1])
    ]
    session.add_all(runs)
    session.flush()
    start_runs(session, runs)
    return calibrations


def ask_to_end(session: Session, calibrations: Select[Any]) -> None:
    """Cancel what has not ended of these calibrations: parts of their runs, and their conclusions."""
    runs = select(CalibrationRun.id).where(
        CalibrationRun.calibration_id.in_(calibrations), CalibrationRun.state.in_(UNENDED)
    )
    cancel(session, runs.union_all(calibrations))


def _runs(plan: CalibrationPlan) -> Iterator[tuple[FitPlan, int]]:
    for fit in plan.fits:
        yield from ((fit, fold) for fold in range(FULL, fit.request.folds))


def _calibration(plan: CalibrationPlan, publish: str, person_id: UUID | None) -> Calibration:
    pairs = plan.fits[0].camera.pairs
    return Calibration(
        fleet_id=pairs.fleet_id,
        vehicle_id=pairs.vehicle_id,
        rig_id=pairs.rig_id,
        request=plan.request,
        content_hash=plan.content_hash,
        remaining=plan.runs,
        publish=publish,
        notes=plan.notes,
        created_by=person_id,
    )


def _run(calibration: Calibration, fit: FitPlan, fold: int, farm: str, waiting: int, workers: int) -> CalibrationRun:
    slots = fit.request.schedule.slots
    farming = choose_farming(farm, slots=slots, cost=fit.work.cost, waiting_runs=waiting, workers=workers)
    return CalibrationRun(
        fleet_id=calibration.fleet_id,
        calibration_id=calibration.id,
        set_id=fit.camera.pairs.id,
        camera=fit.camera.name,
        model=fit.request.model,
        fold=fold,
        farm=farming.farm,
        slots=slots,
        bundle=farming.bundle,
        fit_request=fit.of_fold(fold),
    )
