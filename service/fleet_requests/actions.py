"""Makes, cancels and retries fleet requests, each with all its calibrations in one transaction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from uuid import UUID

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from apexcal.documents.base import stored
from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.fleet_requests import DryRunView, FleetRequestBody, SkippedView, VehicleFilter
from apexcal.documents.states import RequestState, VehicleState
from service.calibrations.actions import ask_to_end, create_all, waiting_runs
from service.calibrations.work_rules import check_fleet_total
from service.fleet_requests.plan import VehiclePlan, check_template, plan_vehicles
from service.fleet_requests.vehicle_queries import Chosen, choose
from service.platform.db.base import new_id
from service.platform.db.clock import utc_now
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Fleet
from service.platform.http.problems import Problem

# More at once would hold the database for longer than a lease (docs/decisions/0018).
_MOST_VEHICLES = 5000
_MOST_RUNS = 20_000
# Rows that they may leave, of 465 bytes each: five gigabytes. So many runs with the schedule `paper` come to 6
# million at most.
_MOST_SLOTS = 10_000_000
_SHOWN = 100


def ask(session: Session, fleet: Fleet, body: FleetRequestBody, person_id: UUID, workers: int) -> FleetRequest:
    """Insert a request, its vehicles and their calibrations.

    Raises:
        Problem: 422 of the filter, of the template, or ``fleet_request_too_large``.
    """
    chosen = _choose(session, fleet.id, body)
    row = FleetRequest(
        fleet_id=fleet.id,
        asked=body.model_dump(mode="json", include={"vehicles", "calibration"}),
        state=RequestState.RUNNING,
        matched=len(chosen),
        remaining=0,
        wave=0,
        created_by=person_id,
    )
    session.add(row)
    session.flush()
    # Ids sort by time, but not within a millisecond.
    ids = dict(zip((vehicle.id for vehicle in chosen), sorted(new_id() for _ in chosen), strict=True))
    total = _Total()
    for planned in plan_vehicles(session, body.calibration, chosen):
        total.add(planned)
        calibrations = _calibrate(session, planned, body.calibration, person_id, workers, len(chosen))
        session.add_all(_vehicle(row, ids[plan.vehicle.id], plan, calibrations) for plan in planned)
        row.skipped += sum(plan.plan is None for plan in planned)
    _begin(row, row.matched - row.skipped)
    return row


def preview(session: Session, fleet: Fleet, body: FleetRequestBody) -> DryRunView:
    """The prediction of :func:`ask`, which makes nothing. Raises as it does."""
    chosen = _choose(session, fleet.id, body)
    skipped: list[SkippedView] = []
    total = _Total()
    for planned in plan_vehicles(session, body.calibration, chosen):
        total.add(planned)
        skipped += [
            SkippedView(vehicle_id=plan.vehicle.id, vehicle=plan.vehicle.name, problem=stored(plan.problem))
            for plan in planned
            if plan.problem is not None
        ]
    return DryRunView(
        matched=len(chosen),
        calibrations=len(chosen) - len(skipped),
        runs=total.runs,
        processor_seconds=round(total.seconds),
        skipped=len(skipped),
        skipped_vehicles=skipped[:_SHOWN],
    )


def ask_all_to_end(session: Session, row: FleetRequest) -> None:
    """Cancel every vehicle that has not ended. Its calibrations before the request: the order of all locks."""
    vehicles = FleetRequestVehicle
    # A retry holds the failed ones: wait for it, so that what it began is seen below. No worker waits for this.
    failed = select(vehicles.id).where(vehicles.fleet_request_id == row.id, vehicles.state == VehicleState.FAILED)
    session.execute(failed.with_for_update(read=True, key_share=True)).all()
    unended = select(vehicles.calibration_id).where(
        vehicles.fleet_request_id == row.id, vehicles.state == VehicleState.QUEUED
    )
    ask_to_end(session, unended)
    session.execute(
        update(FleetRequest)
        .where(FleetRequest.id == row.id, FleetRequest.remaining > 0)
        .values(cancel_requested=True)
        .execution_options(synchronize_session=False)
    )
    session.refresh(row)


def retry_failed(session: Session, row: FleetRequest, person_id: UUID, workers: int) -> None:
    """Calibrate the failed vehicles again, each from its newest pairs now. Where none failed, nothing changes.

    A vehicle that has no fitting pairs any more becomes a skipped one.
    """
    # Locked, so that of two retries at the same moment the second finds nothing failed.
    failed = session.scalars(
        select(FleetRequestVehicle)
        .where(FleetRequestVehicle.fleet_request_id == row.id, FleetRequestVehicle.state == VehicleState.FAILED)
        .order_by(FleetRequestVehicle.id)
        .with_for_update()
    ).all()
    if not failed:
        return
    template = CalibrationTemplate.model_validate(row.asked["calibration"])
    by_vehicle = {vehicle.vehicle_id: vehicle for vehicle in failed}
    rig = VehicleFilter.model_validate(row.asked["vehicles"]).rig
    chosen = choose(session, row.fleet_id, VehicleFilter(vehicle_ids=list(by_vehicle), rig=rig))
    begun, total = 0, _Total()
    for planned in plan_vehicles(session, template, chosen):
        total.add(planned)
        calibrations = _calibrate(session, planned, template, person_id, workers, len(chosen))
        for plan in planned:
            vehicle = by_vehicle[plan.vehicle.id]
            vehicle.calibration_id = calibrations.get(plan.vehicle.id)
            vehicle.state, vehicle.problem, vehicle.finished_at = _first_state(plan)
            begun += plan.plan is not None
    session.flush()
    session.refresh(row, with_for_update=True)
    row.failed -= len(failed)
    row.skipped += len(failed) - begun
    row.cancel_requested = False
    _begin(row, begun)


def _choose(session: Session, fleet_id: UUID, body: FleetRequestBody) -> list[Chosen]:
    # First, so that an unusable template is refused even if no vehicle is due.
    check_template(body.calibration)
    chosen = choose(session, fleet_id, body.vehicles)
    if len(chosen) > _MOST_VEHICLES:
        raise _too_large(f"{len(chosen)} vehicles", f"{_MOST_VEHICLES} vehicles")
    return chosen


@dataclass
class _Total:
    """Totals of a request's vehicles so far."""

    runs: int = 0
    slots: int = 0
    seconds: float = 0.0

    def add(self, planned: Sequence[VehiclePlan]) -> None:
        """Count some vehicles more. Raises :class:`Problem` 422 ``fleet_request_too_large``."""
        plans = [vehicle.plan for vehicle in planned if vehicle.plan]
        self.runs += sum(plan.runs for plan in plans)
        self.slots += sum(fit.work.runs * fit.work.cost.slots for plan in plans for fit in plan.fits)
        self.seconds += sum(plan.predicted_s for plan in plans)
        if self.runs > _MOST_RUNS:
            raise _too_large(f"more than {_MOST_RUNS} runs (cameras x models x (folds + 1))", f"{_MOST_RUNS} runs")
        if self.slots > _MOST_SLOTS:
            raise _too_large(f"more than {_MOST_SLOTS:,} slots", f"{_MOST_SLOTS:,} slots")
        check_fleet_total(self.seconds)


def _too_large(what: str, most: str) -> Problem:
    return Problem(
        422,
        "fleet_request_too_large",
        f"This request comes to {what}, and one request takes at most {most}.",
        "Ask in several requests: narrow the filter, or ask for fewer models or folds.",
    )


def _calibrate(
    session: Session,
    planned: Sequence[VehiclePlan],
    template: CalibrationTemplate,
    person_id: UUID,
    workers: int,
    vehicles: int,
) -> dict[UUID, UUID]:
    """Insert these vehicles' calibrations; their ids by vehicle."""
    plans = [
        (vehicle.rig, vehicle.plan) for vehicle in planned if vehicle.rig is not None and vehicle.plan is not None
    ]
    if not plans:
        return {}
    waiting = waiting_runs(session, workers) + vehicles
    calibrations = create_all(session, plans, template.farm, template.publish, person_id, workers, waiting)
    return {calibration.vehicle_id: calibration.id for calibration in calibrations}


def _vehicle(row: FleetRequest, id: UUID, plan: VehiclePlan, calibrations: dict[UUID, UUID]) -> FleetRequestVehicle:
    state, problem, finished_at = _first_state(plan)
    return FleetRequestVehicle(
        id=id,
        fleet_request_id=row.id,
        vehicle_id=plan.vehicle.id,
        calibration_id=calibrations.get(plan.vehicle.id),
        state=state,
        problem=problem,
        finished_at=finished_at,
    )


def _first_state(plan: VehiclePlan) -> tuple[str, dict[str, object] | None, datetime | None]:
    return (
        (VehicleState.QUEUED, None, None)
        if plan.plan is not None
        else (VehicleState.SKIPPED, plan.problem, utc_now())
    )


def _begin(row: FleetRequest, begun: int) -> None:
    """Put the request to work on ``begun`` more vehicles, or end it where there is nothing to do."""
    row.remaining += begun
    row.wave, row.started_at = row.remaining, utc_now()
    if row.remaining:
        row.state, row.finished_at = RequestState.RUNNING, None
    else:
        row.state = RequestState.DONE_WITH_FAILURES if row.failed + row.cancelled else RequestState.DONE
        row.finished_at = utc_now()
