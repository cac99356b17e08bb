"""The end of a calibration: its state, its summary, and what its fleet request hears of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from uuid import UUID

from sqlalchemy import ColumnElement, bindparam, case, update
from sqlalchemy.orm import Session

from apexcal.documents.states import RequestState, VehicleState, WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration
from service.platform.db.clock import now
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle


def end_calibration(
    session: Session, calibration: Calibration, state: WorkState, problem: Json | None, summary: Json | None = None
) -> None:
    """End a calibration whose runs have all ended, and count it in its fleet request."""
    calibration.state, calibration.problem, calibration.summary = state, problem, summary
    calibration.finished_at = now()
    tell_fleet_request(session, calibration)
    hint(session, calibration.fleet_id, "calibration", calibration.id)


# Each is a column that counts the vehicles which came to it.
_ENDED = (VehicleState.DONE, VehicleState.FAILED, VehicleState.CANCELLED, VehicleState.SKIPPED)
# Built once, as those of :mod:`service.platform.jobs.claims`.
_END_VEHICLES = (
    update(FleetRequestVehicle)
    .where(
        FleetRequestVehicle.calibration_id.in_(bindparam("calibrations", expanding=True)),
        FleetRequestVehicle.state == VehicleState.QUEUED,
    )
    .values(state=bindparam("ended_as"), problem=bindparam("because"), finished_at=now())
    .returning(FleetRequestVehicle.fleet_request_id)
)


def tell_fleet_request(session: Session, calibration: Calibration) -> None:
    """Count a calibration that just ended as done, failed or cancelled, where a fleet request asked for it."""
    session.flush()
    _end_vehicles(session, [calibration.id], calibration.state, calibration.problem)


def drop_calibrations(session: Session, calibration_ids: Iterable[UUID]) -> None:
    """Count calibrations that are about to be deleted with their recording, as cancelled where they had not ended."""
    _end_vehicles(session, list(calibration_ids), VehicleState.CANCELLED, _DELETED)


def count_ended(session: Session, request_id: UUID, ended: Mapping[str, int]) -> None:
    """Take vehicles off the request's remaining ones; the last one ends it. One statement.

    ``ended``: how many came to each of done, failed, cancelled, skipped. A cancelled request that has nothing
    cancelled is one whose vehicles were all done before the cancel reached them.
    """
    counts = {name: getattr(FleetRequest, name) + ended.get(name, 0) for name in _ENDED}
    left = FleetRequest.remaining - sum(ended.values())
    fleet_id = session.execute(
        update(FleetRequest)
        .where(FleetRequest.id == request_id)
        .values(
            **counts,
            remaining=left,
            wave=FleetRequest.wave - ended.get(VehicleState.SKIPPED, 0),
            state=case((left > 0, RequestState.RUNNING), else_=_end_state(counts)),
            finished_at=case((left > 0, None), else_=now()),
        )
        .returning(FleetRequest.fleet_id)
    ).scalar_one()
    hint(session, fleet_id, "fleet_request", request_id)


def _end_state(counts: Mapping[VehicleState, ColumnElement[int]]) -> ColumnElement[str]:
    failed, cancelled = counts[VehicleState.FAILED], counts[VehicleState.CANCELLED]
    return case(
        (FleetRequest.cancel_requested & (cancelled > 0), RequestState.CANCELLED),
        (failed + cancelled > 0, RequestState.DONE_WITH_FAILURES),
        else_=RequestState.DONE,
    )


def _end_vehicles(session: Session, calibration_ids: list[UUID], state: str, problem: Json | None) -> None:
    """End the vehicles that wait for these calibrations; each once, whoever comes second finds it ended."""
    ended = {"calibrations": calibration_ids, "ended_as": state, "because": problem}
    requests = session.connection().execute(_END_VEHICLES, ended).scalars()
    for request_id, count in sorted(Counter(requests).items()):
        count_ended(session, request_id, {state: count})


_DELETED: Json = {
    "code": "recording_deleted",
    "detail": "The recording that this vehicle's pairs came from was deleted meanwhile.",
    "hint": "Ask again when the vehicle has other pairs.",
}
