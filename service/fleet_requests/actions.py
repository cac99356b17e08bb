"""Makes, cancels and retries fleet requests. Their calibrations follow in parts, each a transaction of its own."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from math import ceil
from uuid import UUID

from sqlalchemy import insert, select, update
from sqlalchemy.orm import Session

from apexcal.documents.base import stored
from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.fleet_requests import DryRunView, FleetRequestBody, SkippedView, SkipReason
from apexcal.documents.states import RequestState, VehicleState
from service.calibration_runs.conclusion import count_ended
from service.calibrations.actions import ask_to_end, create_all
from service.fleet_requests.plan import VehiclePlan, check_template, check_total, plan_vehicles, too_large
from service.fleet_requests.vehicle_queries import Chosen, choose, with_newest_sets
from service.platform.db.base import Json, new_id, state_literal
from service.platform.db.clock import now, utc_now
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Fleet, Vehicle
from service.platform.db.rounds import one_by_one
from service.platform.db.session import Database
from service.platform.observability import request_ids

# Their rows are inserted in the transaction that makes the request (docs/decisions/0018).
_MOST_VEHICLES = 5000
# Vehicles whose calibrations one transaction makes: 50 ms, in which SQLite lets nobody else write.
_PART = 50
_SHOWN = 100
_EXAMPLES = 12
_REPEATED = (VehicleState.FAILED, VehicleState.CANCELLED)

# Asked for, and without a calibration yet.
_IS_DUE = (FleetRequestVehicle.state == state_literal(VehicleState.QUEUED)) & (
    FleetRequestVehicle.calibration_id.is_(None)
)


def ask(session: Session, fleet: Fleet, body: FleetRequestBody, person_id: UUID) -> FleetRequest:
    """Insert a request with its vehicles, and the calibrations of the first part of them.

    Raises:
        Problem: 422 of the filter, of the template, or ``fleet_request_too_large``.
    """
    chosen = _choose(session, fleet.id, body)
    named = body.vehicles.vehicle_ids
    filter_ = body.vehicles.model_dump(mode="json", exclude={"vehicle_ids"})
    row = FleetRequest(
        fleet_id=fleet.id,
        asked={
            "vehicles": filter_ | {"named": None if named is None else len(set(named))},
            "calibration": body.calibration.model_dump(mode="json"),
        },
        state=RequestState.RUNNING,
        matched=len(chosen),
        remaining=len(chosen),
        wave=len(chosen),
        request_id=request_ids.current(),
        created_by=person_id,
    )
    session.add(row)
    session.flush()
    if not chosen:
        row.state, row.finished_at = RequestState.DONE, utc_now()
        return row
    # Ids sort by time, but not within a millisecond.
    ids = sorted(new_id() for _ in chosen)
    values = [
        {"id": id, "fleet_request_id": row.id, "vehicle_id": vehicle.id, "state": VehicleState.QUEUED}
        for id, vehicle in zip(ids, chosen, strict=True)
    ]
    session.execute(insert(FleetRequestVehicle), values)
    _insert_part(session, row, _plan_part(session, row))
    return row


def make_parts(database: Database) -> None:
    """Make the calibrations that fleet requests still lack: a part of each request at a time.

    A request that fails waits for the next round.
    """
    due = select(FleetRequestVehicle.id).where(_IS_DUE, FleetRequestVehicle.fleet_request_id == FleetRequest.id)
    waits = select(FleetRequest.id).where(FleetRequest.state == state_literal(RequestState.RUNNING), due.exists())
    failed: set[UUID] = set()
    while True:
        with database.reading() as session:
            requests = session.scalars(waits.where(FleetRequest.id.not_in(failed)).order_by(FleetRequest.id)).all()
        if not requests:
            return
        one_by_one("fleet request", requests, partial(_make_part, database), failed)


def _make_part(database: Database, request_id: UUID) -> None:
    with database.reading() as session:
        planned = _plan_part(session, session.get_one(FleetRequest, request_id))
    # Planning takes most of the time, and nobody waits for it: SQLite has one writer.
    with database.writing() as session:
        row = session.get_one(FleetRequest, request_id)
        with request_ids.working_for(row.request_id):
            _insert_part(session, row, planned)


def preview(session: Session, fleet: Fleet, body: FleetRequestBody) -> DryRunView:
    """The prediction of :func:`ask`, which makes nothing. Raises as it does."""
    chosen = _choose(session, fleet.id, body)
    skipped: list[SkippedView] = []
    problems: list[tuple[str, Json]] = []
    runs, seconds = 0, 0.0
    for planned in plan_vehicles(session, body.calibration, chosen):
        plans = [vehicle.plan for vehicle in planned if vehicle.plan]
        runs += sum(plan.runs for plan in plans)
        seconds += sum(plan.predicted_s for plan in plans)
        problems += [(plan.vehicle.name, plan.problem) for plan in planned if plan.problem is not None]
        skipped += [
            SkippedView(vehicle_id=plan.vehicle.id, vehicle=plan.vehicle.name, problem=stored(plan.problem))
            for plan in planned
            if plan.problem is not None
        ]
    return DryRunView(
        matched=len(chosen),
        calibrations=len(chosen) - len(skipped),
        runs=runs,
        processor_seconds=ceil(seconds),
        skipped=len(skipped),
        reasons=_reasons(problems),
        skipped_vehicles=skipped[:_SHOWN],
    )


def _reasons(problems: Sequence[tuple[str, Json]]) -> list[SkipReason]:
    """Why vehicles are skipped, what most share first, each with the first of them."""
    vehicles: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    for vehicle, problem in problems:
        vehicles[problem.get("detail") or problem["code"], problem.get("hint") or ""].append(vehicle)
    return [
        SkipReason(detail=detail, hint=hint, count=len(names), examples=names[:_EXAMPLES])
        for (detail, hint), names in sorted(vehicles.items(), key=lambda item: -len(item[1]))[:_SHOWN]
    ]


def ask_all_to_end(session: Session, row: FleetRequest) -> None:
    """Cancel every vehicle that has not ended. Its calibrations before the request: the order of all locks."""
    vehicles = FleetRequestVehicle
    # A retry holds the failed ones, a part its own: wait for them, so that what they began is seen below.
    failed = select(vehicles.id).where(vehicles.fleet_request_id == row.id, vehicles.state.in_(_REPEATED))
    session.execute(failed.with_for_update(read=True, key_share=True)).all()
    dropped = session.execute(
        update(vehicles)
        .where(vehicles.fleet_request_id == row.id, _IS_DUE)
        .values(state=VehicleState.CANCELLED, finished_at=now())
        .returning(vehicles.id)
    ).all()
    unended = select(vehicles.calibration_id).where(
        vehicles.fleet_request_id == row.id, vehicles.state == VehicleState.QUEUED
    )
    ask_to_end(session, unended)
    session.execute(
        update(FleetRequest)
        .where(FleetRequest.id == row.id, FleetRequest.remaining > 0)
        .values(cancel_requested=True)
    )
    if dropped:
        count_ended(session, row.id, {VehicleState.CANCELLED: len(dropped)})
    session.refresh(row)


def retry_failed(session: Session, row: FleetRequest) -> None:
    """Calibrate the failed and the cancelled vehicles again, each from its newest pairs; without any, change nothing.

    A vehicle that has no fitting pairs any more becomes a skipped one.
    """
    # Locked, so that of two retries at the same moment the second finds nothing failed.
    failed = session.execute(
        update(FleetRequestVehicle)
        .where(FleetRequestVehicle.fleet_request_id == row.id, FleetRequestVehicle.state.in_(_REPEATED))
        .values(state=VehicleState.QUEUED, calibration_id=None, problem=None, finished_at=None)
        .returning(FleetRequestVehicle.id)
    ).all()
    if not failed:
        return
    session.refresh(row, with_for_update=True)
    # No vehicle is left in either state.
    row.failed = row.cancelled = 0
    row.remaining += len(failed)
    row.wave, row.started_at = row.remaining, utc_now()
    row.state, row.finished_at, row.cancel_requested = RequestState.RUNNING, None, False
    session.flush()
    _insert_part(session, row, _plan_part(session, row))


def _plan_part(session: Session, row: FleetRequest) -> list[VehiclePlan]:
    """Plan the calibrations of the next vehicles of a request that lack one."""
    due = (
        select(Vehicle.id, Vehicle.name)
        .join(FleetRequestVehicle, Vehicle.id == FleetRequestVehicle.vehicle_id)
        .where(FleetRequestVehicle.fleet_request_id == row.id, _IS_DUE)
        .order_by(FleetRequestVehicle.id)
        .limit(_PART)
    )
    names = dict(iter(session.execute(due)))
    template = CalibrationTemplate.model_validate(row.asked["calibration"])
    chosen = with_newest_sets(session, row.fleet_id, names, row.asked["vehicles"]["rig"])
    return [plan for planned in plan_vehicles(session, template, chosen) for plan in planned]


def _insert_part(session: Session, row: FleetRequest, planned: Sequence[VehiclePlan]) -> None:
    """Insert the calibrations of planned vehicles that still lack one, or say why they are skipped."""
    plans = {plan.vehicle.id: plan for plan in planned}
    due = select(FleetRequestVehicle).where(
        FleetRequestVehicle.fleet_request_id == row.id, _IS_DUE, FleetRequestVehicle.vehicle_id.in_(plans)
    )
    vehicles = session.scalars(due.order_by(FleetRequestVehicle.id).with_for_update()).all()
    template = CalibrationTemplate.model_validate(row.asked["calibration"])
    calibrations = _calibrate(session, [plans[vehicle.vehicle_id] for vehicle in vehicles], template, row)
    skipped = 0
    for vehicle in vehicles:
        vehicle.calibration_id = calibrations.get(vehicle.vehicle_id)
        if vehicle.calibration_id is None:
            vehicle.state, vehicle.problem = VehicleState.SKIPPED, plans[vehicle.vehicle_id].problem
            vehicle.finished_at = utc_now()
            skipped += 1
    session.flush()
    if skipped:
        count_ended(session, row.id, {VehicleState.SKIPPED: skipped})
    session.refresh(row)


def _choose(session: Session, fleet_id: UUID, body: FleetRequestBody) -> list[Chosen]:
    # First, so that an unusable template is refused even if no vehicle is due.
    check_template(body.calibration)
    chosen = choose(session, fleet_id, body.vehicles)
    if len(chosen) > _MOST_VEHICLES:
        raise too_large(f"{len(chosen)} vehicles", f"{_MOST_VEHICLES} vehicles")
    check_total(session, body.calibration, chosen)
    return chosen


def _calibrate(
    session: Session, planned: Sequence[VehiclePlan], template: CalibrationTemplate, row: FleetRequest
) -> dict[UUID, UUID]:
    """Insert these vehicles' calibrations; their ids by vehicle."""
    plans = [
        (vehicle.rig, vehicle.plan) for vehicle in planned if vehicle.rig is not None and vehicle.plan is not None
    ]
    if not plans:
        return {}
    calibrations = create_all(session, plans, template.farm, template.publish, row.created_by, row.remaining)
    return {calibration.vehicle_id: calibration.id for calibration in calibrations}
