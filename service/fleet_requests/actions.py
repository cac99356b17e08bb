"""Makes, cancels and retries fleet requests. Their calibrations follow in parts, each a transaction of its own."""

from __future__ import annotations

import secrets
from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from math import ceil
from uuid import UUID

from sqlalchemy import func, insert, select, update
from sqlalchemy.orm import Session

from apexcal.documents.base import stored
from apexcal.documents.calibrations import CalibrationTemplate
from apexcal.documents.fleet_requests import DryRunView, FleetRequestBody, SkippedView, SkipReason
from apexcal.documents.states import VehicleState
from service.calibrations.actions import ask_to_end, create
from service.fleet_requests.plan import VehiclePlan, check_template, check_total, plan_vehicles, too_large
from service.fleet_requests.vehicle_queries import Chosen, choose, with_newest_sets
from service.platform.broker.hints import hint
from service.platform.db.base import new_id, state_literal
from service.platform.db.clock import moment, now, utc_now
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Fleet, Vehicle
from service.platform.db.rounds import one_by_one
from service.platform.db.session import Database
from service.platform.observability import request_ids

# Their rows are inserted in the transaction that makes the request (docs/decisions/0018).
_MOST_VEHICLES = 5000
# Vehicles whose calibrations one transaction makes: 50 ms, in which SQLite lets nobody else write.
_PART = 50
# Several services plan one request. Each plans one of its next parts, so that few plan the same vehicles.
_NEXT_PARTS = 8
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
        request_id=request_ids.current(),
        created_by=person_id,
    )
    session.add(row)
    session.flush()
    if not chosen:
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
    of = FleetRequestVehicle.fleet_request_id
    failed: set[UUID] = set()
    while True:
        with database.reading() as session:
            requests = session.scalars(select(of).where(_IS_DUE, of.not_in(failed)).distinct().order_by(of)).all()
        if not requests:
            return
        one_by_one("fleet request", requests, partial(_make_part, database), failed)


def _make_part(database: Database, request_id: UUID) -> None:
    with database.reading() as session:
        row = session.get_one(FleetRequest, request_id)
        planned = _plan_part(session, row, secrets.randbelow(_NEXT_PARTS)) or _plan_part(session, row)
    # Planning takes most of the time, and nobody waits for it: SQLite has one writer.
    with database.writing() as session:
        row = session.get_one(FleetRequest, request_id)
        with request_ids.working_for(row.request_id):
            _insert_part(session, row, planned)
        hint(session, row.fleet_id, "fleet_request", row.id)


def preview(session: Session, fleet: Fleet, body: FleetRequestBody) -> DryRunView:
    """The prediction of :func:`ask`, which makes nothing. Raises as it does."""
    chosen = _choose(session, fleet.id, body)
    skipped: list[VehiclePlan] = []
    runs, seconds = 0, 0.0
    for planned in plan_vehicles(session, body.calibration, chosen):
        if planned.plan is None:
            skipped.append(planned)
        else:
            runs, seconds = runs + planned.plan.runs, seconds + planned.plan.predicted_s
    return DryRunView(
        matched=len(chosen),
        calibrations=len(chosen) - len(skipped),
        runs=runs,
        processor_seconds=ceil(seconds),
        skipped=len(skipped),
        reasons=_reasons(skipped),
        skipped_vehicles=[
            SkippedView(vehicle_id=each.vehicle.id, vehicle=each.vehicle.name, problem=stored(each.problem))
            for each in skipped[:_SHOWN]
        ],
    )


def _reasons(skipped: Sequence[VehiclePlan]) -> list[SkipReason]:
    """Why vehicles are skipped, what most share first, each with the first of them."""
    vehicles: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    for each in skipped:
        problem = each.problem or {}
        vehicles[problem.get("detail") or problem["code"], problem.get("hint") or ""].append(each.vehicle.name)
    return [
        SkipReason(detail=detail, hint=hint, count=len(names), examples=names[:_EXAMPLES])
        for (detail, hint), names in sorted(vehicles.items(), key=lambda item: -len(item[1]))[:_SHOWN]
    ]


def ask_all_to_end(session: Session, row: FleetRequest) -> None:
    """Cancel every vehicle that has not ended."""
    _hold(session, row)
    unended = (FleetRequestVehicle.fleet_request_id == row.id, FleetRequestVehicle.state == VehicleState.QUEUED)
    row.cancel_requested |= session.scalar(select(FleetRequestVehicle.id).where(*unended).limit(1)) is not None
    # Those of a part that is being made are waited for: they have calibrations then.
    due = update(FleetRequestVehicle).where(*unended, _IS_DUE)
    session.execute(due.values(state=VehicleState.CANCELLED, finished_at=now()))
    ask_to_end(session, select(FleetRequestVehicle.calibration_id).where(*unended))


def retry_failed(session: Session, row: FleetRequest) -> None:
    """Calibrate the failed and the cancelled vehicles again, each from its newest pairs; without any, change nothing.

    A vehicle that has no fitting pairs any more becomes a skipped one.
    """
    _hold(session, row)
    failed = session.execute(
        update(FleetRequestVehicle)
        .where(FleetRequestVehicle.fleet_request_id == row.id, FleetRequestVehicle.state.in_(_REPEATED))
        .values(state=VehicleState.QUEUED, calibration_id=None, problem=None, finished_at=None)
        .returning(FleetRequestVehicle.id)
    ).all()
    if failed:
        row.started_at, row.cancel_requested = moment(session), False
        _insert_part(session, row, _plan_part(session, row))


def _hold(session: Session, row: FleetRequest) -> None:
    """Let nobody else cancel or retry the request until the commit."""
    session.refresh(row, with_for_update={"key_share": True})


def _plan_part(session: Session, row: FleetRequest, parts_before: int = 0) -> list[VehiclePlan]:
    """Plan the calibrations of some vehicles of a request that lack one. The parts before are left to others."""
    due = (
        select(Vehicle.id, Vehicle.name)
        .join(FleetRequestVehicle, Vehicle.id == FleetRequestVehicle.vehicle_id)
        .where(FleetRequestVehicle.fleet_request_id == row.id, _IS_DUE)
        .order_by(FleetRequestVehicle.id)
        .offset(parts_before * _PART)
        .limit(_PART)
    )
    names = dict(iter(session.execute(due)))
    template = CalibrationTemplate.model_validate(row.asked["calibration"])
    chosen = with_newest_sets(session, row.fleet_id, names, row.asked["vehicles"]["rig"])
    return [*plan_vehicles(session, template, chosen)]


def _insert_part(session: Session, row: FleetRequest, planned: Sequence[VehiclePlan]) -> None:
    """Insert the calibrations of planned vehicles that still lack one, or say why they are skipped."""
    plans = {plan.vehicle.id: plan for plan in planned}
    due = select(FleetRequestVehicle).where(
        FleetRequestVehicle.fleet_request_id == row.id, _IS_DUE, FleetRequestVehicle.vehicle_id.in_(plans)
    )
    vehicles = session.scalars(due.order_by(FleetRequestVehicle.id).with_for_update()).all()
    template = CalibrationTemplate.model_validate(row.asked["calibration"])
    of_request = select(func.count()).where(FleetRequestVehicle.fleet_request_id == row.id, _IS_DUE)
    coming = session.scalar(of_request) or 0
    usable = [plan for vehicle in vehicles if (plan := plans[vehicle.vehicle_id].plan) is not None]
    calibrations = create(session, usable, template.farm, template.publish, row.created_by, coming) if usable else []
    of_vehicle = {calibration.vehicle_id: calibration.id for calibration in calibrations}
    for vehicle in vehicles:
        vehicle.calibration_id = of_vehicle.get(vehicle.vehicle_id)
        if vehicle.calibration_id is None:
            vehicle.state, vehicle.problem = VehicleState.SKIPPED, plans[vehicle.vehicle_id].problem
            vehicle.finished_at = utc_now()
    session.flush()


def _choose(session: Session, fleet_id: UUID, body: FleetRequestBody) -> list[Chosen]:
    # First, so that an unusable template is refused even if no vehicle is due.
    check_template(body.calibration)
    chosen = choose(session, fleet_id, body.vehicles)
    if len(chosen) > _MOST_VEHICLES:
        raise too_large(f"{len(chosen)} vehicles", f"{_MOST_VEHICLES} vehicles")
    check_total(session, body.calibration, chosen)
    return chosen
