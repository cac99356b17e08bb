"""Fleet requests and their vehicles, as the answers show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, Select, case, func, or_, select
from sqlalchemy.orm import Session, aliased

from apexcal.documents.calibrations import ProgressView
from apexcal.documents.checks import doubts_of, verdict_of
from apexcal.documents.fleet_requests import CameraOutcome, Counts, FleetRequestView, RequestVehicleView
from apexcal.documents.publications import CURRENT
from apexcal.documents.states import RequestState, VehicleState, WorkState
from apexcal.documents.summaries import CameraSummary, Summary
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CalibrationRun, Publication, Result
from service.platform.db.clock import utc_now
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Vehicle
from service.platform.db.jobs import Job
from service.platform.db.people import Person

# Before this many vehicles have ended, their pace tells too little.
_LEAST_ENDED = 3


def is_running() -> ColumnElement[bool]:
    """Whether work on a queued vehicle has begun: a run of its calibration has ended, or a job of it is being done.

    The jobs that are running are few, however many wait.
    """
    worked_on = (
        select(CalibrationRun.calibration_id)
        .join(Job, Job.subject_id == CalibrationRun.id)
        .where(Job.state == WorkState.RUNNING, Job.queue == "solve")
    )
    theirs = aliased(Calibration)
    begun = (
        select(theirs.id)
        .where(theirs.id == FleetRequestVehicle.calibration_id, theirs.state == WorkState.RUNNING)
        .correlate(FleetRequestVehicle)
    )
    return (FleetRequestVehicle.state == VehicleState.QUEUED) & or_(
        FleetRequestVehicle.calibration_id.in_(worked_on), begun.exists()
    )


def in_state(statement: Select[*tuple[Any, ...]], state: VehicleState) -> Select[*tuple[Any, ...]]:
    """The vehicles of a statement that are in this state."""
    if state == VehicleState.RUNNING:
        return statement.where(is_running())
    statement = statement.where(FleetRequestVehicle.state == state)
    return statement.where(~is_running()) if state == VehicleState.QUEUED else statement


def request_views(session: Session, rows: Sequence[FleetRequest]) -> list[FleetRequestView]:
    """Fleet requests with their counts, and the names of who asked."""
    counts = _counts(session, [row.id for row in rows])
    names = _names(session, {row.created_by for row in rows if row.created_by})
    publishing = [row.id for row in rows if not counts[row.id].remaining and _asked_to_publish(row)]
    published = dict.fromkeys(publishing, 0) | _published(session, publishing)
    return [_request_view(row, counts[row.id], published.get(row.id), names.get(row.created_by)) for row in rows]


def _counts(session: Session, ids: Sequence[UUID]) -> dict[UUID, Any]:
    """How many vehicles of each request are in which state, by one look at each, and when the last one ended."""
    vehicle = FleetRequestVehicle
    each = (
        select(FleetRequest.id, vehicle.id.label("vehicle"), vehicle.finished_at)
        .add_columns(case((is_running(), VehicleState.RUNNING), else_=vehicle.state).label("state"))
        .add_columns((vehicle.finished_at >= FleetRequest.started_at).label("is_of_wave"))
        .select_from(FleetRequest)
        .outerjoin(vehicle, vehicle.fleet_request_id == FleetRequest.id)
        .where(FleetRequest.id.in_(ids))
        .subquery()
    )
    state, count = each.c.state, func.count(each.c.vehicle)
    statement = select(
        *(each.c.id, count.label("matched"), func.max(each.c.finished_at).label("ended_at")),
        *(count.filter(state == name).label(name) for name in VehicleState),
        count.filter(state.in_((VehicleState.QUEUED, VehicleState.RUNNING))).label("remaining"),
        # Of those that were put to work last.
        count.filter(state != VehicleState.SKIPPED, each.c.is_of_wave).label("ended"),
    ).group_by(each.c.id)
    return {row.id: row for row in session.execute(statement)}


def _state(row: FleetRequest, counts: Any) -> RequestState:
    """A cancelled request that has nothing cancelled is one whose vehicles were all done before the cancel."""
    if counts.remaining:
        return RequestState.RUNNING
    if row.cancel_requested and counts.cancelled:
        return RequestState.CANCELLED
    return RequestState.DONE_WITH_FAILURES if counts.failed + counts.cancelled else RequestState.DONE


def _asked_to_publish(row: FleetRequest) -> bool:
    return row.asked["calibration"]["publish"] == "recommended"


def _published(session: Session, ids: Sequence[UUID]) -> dict[UUID, int]:
    """For how many vehicles of each request a result of it was published. Only of those that have ended: it takes
    a look at each of their results."""
    of = FleetRequestVehicle.fleet_request_id
    statement = (
        select(of, func.count(FleetRequestVehicle.vehicle_id.distinct()))
        .join(Result, Result.calibration_id == FleetRequestVehicle.calibration_id)
        .join(Publication, Publication.result_id == Result.id)
        .where(of.in_(ids), Publication.alias == CURRENT)
        .group_by(of)
    )
    return {row[0]: row[1] for row in session.execute(statement)} if ids else {}


def _names(session: Session, ids: set[UUID]) -> dict[UUID | None, str]:
    rows = session.execute(select(Person.id, Person.name).where(Person.id.in_(ids))) if ids else ()
    return {row[0]: row[1] for row in rows}


def _request_view(row: FleetRequest, counts: Any, published: int | None, asked_by: str | None) -> FleetRequestView:
    # What is skipped is no work: 238 skipped of 250 do not make the other 12 nearly done.
    at_work = counts.matched - counts.skipped
    ended = at_work - counts.remaining
    message = f"{ended} of {at_work} vehicles have ended" if counts.matched else "no vehicle matched"
    if counts.failed:
        message += f", {counts.failed} of them failed"
    if counts.skipped:
        message += f"; {counts.skipped} skipped"
    return FleetRequestView.of(
        row,
        state=_state(row, counts),
        asked_by=asked_by,
        counts=Counts.of(counts),
        published=published,
        progress=ProgressView(fraction=round(ended / at_work, 4) if at_work else 1.0, message=message),
        seconds_left=_seconds_left(row, counts),
        finished_at=None if counts.remaining else counts.ended_at or row.created_at,
    )


def _seconds_left(row: FleetRequest, counts: Any) -> int | None:
    """By the pace since the newest start, to the second; None where that is not known."""
    if not counts.remaining or counts.ended < _LEAST_ENDED:
        return None
    return round((utc_now() - row.started_at).total_seconds() * counts.remaining / counts.ended)


def vehicles_of(request_id: UUID) -> Select[*tuple[Any, ...]]:
    """A query for (vehicle of the request, its name, whether it is running, its calibration's summary)."""
    return (
        select(FleetRequestVehicle, Vehicle.name, is_running().label("running"), Calibration.summary)
        .join(Vehicle, Vehicle.id == FleetRequestVehicle.vehicle_id)
        .outerjoin(Calibration, Calibration.id == FleetRequestVehicle.calibration_id)
        .where(FleetRequestVehicle.fleet_request_id == request_id)
    )


def vehicle_view(row: FleetRequestVehicle, name: str, running: bool, summary: Json | None) -> RequestVehicleView:
    """One row of :func:`vehicles_of`."""
    return RequestVehicleView.of(
        row,
        vehicle=name,
        state=VehicleState.RUNNING if running else VehicleState(row.state),
        cameras={
            camera: _outcome(of_camera)
            for camera, of_camera in (Summary.model_validate(summary).cameras if summary else {}).items()
        },
    )


def _outcome(camera: CameraSummary) -> CameraOutcome:
    model = camera.models.get(camera.recommended or "")
    return CameraOutcome(
        model=camera.recommended,
        mean_px=model and model.polished.mean_px,
        heldout_mean_px=model and model.heldout_mean_px,
        status=model and model.status,
        verdict=verdict_of(camera.checks, "mount_with_lens") if camera.checks else None,
        checks=doubts_of(camera.checks),
        published=camera.published,
    )
