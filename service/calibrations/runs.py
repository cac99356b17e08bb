"""A calibration's rows: one run for each camera, model and fold, with the first jobs of each."""

from __future__ import annotations

from collections.abc import Iterator
from uuid import UUID

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from service.calibrations.requests import Fit, Plan
from service.db.calibrations import Calibration, CalibrationRun
from service.db.fleets import Rig
from service.jobs.bundles import plan, slot_ms
from service.jobs.queue import cancel
from service.jobs.solving import start_run

FULL = -1
UNENDED = ("queued", "running")


def create(
    session: Session, rig: Rig, asked: Plan, farm: str, publish: str, person_id: UUID, workers: int
) -> Calibration:
    """Insert a calibration with all its runs and their first jobs. Fits to all pairs are worked on first."""
    fits = sorted(_runs(asked), key=lambda run: run[1])
    calibration = Calibration(
        fleet_id=rig.fleet_id,
        vehicle_id=rig.vehicle_id,
        rig_id=rig.id,
        request=asked.request,
        content_hash=asked.content_hash,
        state="queued",
        remaining=len(fits),
        publish=publish,
        notes=asked.notes,
        created_by=person_id,
    )
    session.add(calibration)
    session.flush()
    waiting = len(fits) + (
        session.scalar(select(func.count()).select_from(CalibrationRun).where(CalibrationRun.state.in_(UNENDED))) or 0
    )
    runs = [_run(calibration, fit, fold, asked, farm, waiting, workers) for fit, fold in fits]
    session.add_all(runs)
    session.flush()
    for run in runs:
        start_run(session, run)
    return calibration


def ask_to_end(session: Session, calibration: Calibration) -> None:
    """Cancel what has not ended. Jobs before runs: the order in which everybody locks them."""
    runs = list(
        session.scalars(
            select(CalibrationRun.id).where(
                CalibrationRun.calibration_id == calibration.id, CalibrationRun.state.in_(UNENDED)
            )
        )
    )
    cancel(session, runs)
    session.execute(
        update(CalibrationRun)
        .where(CalibrationRun.id.in_(runs), CalibrationRun.state.in_(UNENDED))
        .values(cancel_requested=True)
        .execution_options(synchronize_session=False)
    )


def _runs(asked: Plan) -> Iterator[tuple[Fit, int]]:
    for fit in asked.fits:
        yield from ((fit, fold) for fold in range(FULL, fit.folds))


def _run(
    calibration: Calibration, fit: Fit, fold: int, asked: Plan, farm: str, waiting: int, workers: int
) -> CalibrationRun:
    size = asked.size
    cost = slot_ms(fit.model, fit.source.pairs.count, size.population, size.generations)
    cut = plan(farm, slots=size.slots, slot_cost_ms=cost, waiting_runs=waiting, workers=workers)
    return CalibrationRun(
        fleet_id=calibration.fleet_id,
        calibration_id=calibration.id,
        set_id=fit.source.pairs.id,
        camera=fit.source.camera.name,
        model=fit.model,
        fold=fold,
        farm=cut.farm,
        slots=size.slots,
        bundle=cut.bundle,
        problem=fit.problem | {"fold": fold},
        state="queued",
    )
