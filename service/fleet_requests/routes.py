"""Routes of fleet requests."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Query
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.fleet_requests import DryRunView, FleetRequestBody, FleetRequestView, RequestVehicleView
from apexcal.documents.states import VehicleState
from service.fleet_requests.actions import ask, ask_all_to_end, preview, retry_failed
from service.fleet_requests.views import in_state, request_views, vehicle_view, vehicles_of
from service.platform.auth.access import ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.base import content_hash
from service.platform.db.fleet_requests import FleetRequest, FleetRequestVehicle
from service.platform.db.fleets import Fleet
from service.platform.http.etags import Conditional, content_etag
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.router import DOCUMENT, Router

router = Router(tags=["fleet requests"])


@router.post(
    "/fleets/{id}/fleet-requests",
    status_code=202,
    response_model=FleetRequestView,
    responses={200: {"model": DryRunView, "description": "a dry run: nothing was made"}},
    max_body_size=DOCUMENT,
)
def ask_fleet(id: UUID, body: FleetRequestBody, access: WriteAccess, reader: ReadAccess) -> JSONResponse:
    """Calibrate every vehicle that a filter names, each from its newest pairs. [engineer]"""
    if body.dry_run:
        # Asked at every pause in typing: it must not wait for SQLite's one writer.
        fleet = reader.find(Fleet, id, "engineer")
        return reader.answer(preview(reader.session, fleet, body), 200)
    fleet = access.find(Fleet, id, "engineer")
    row = ask(access.session, fleet, body, access.person.id)
    access.session.flush()
    hint(access.session, fleet.id, "fleet_request", row.id)
    return access.answer(request_views(access.session, [row])[0], 202)


@router.get("/fleets/{id}/fleet-requests")
def list_fleet_requests(id: UUID, access: ReadAccess, window: Paging) -> Page[FleetRequestView]:
    """A fleet's requests, newest first."""
    fleet = access.find(Fleet, id)
    statement = select(FleetRequest).where(FleetRequest.fleet_id == fleet.id)
    rows, following = fetch(access.session, statement, FleetRequest.id, window, newest_first=True)
    return Page(items=request_views(access.session, rows), next=following)


@router.get("/fleet-requests/{fleet_request_id}")
def read_fleet_request(fleet_request_id: UUID, access: ReadAccess, conditions: Conditional) -> FleetRequestView:
    """A fleet request: how far it is, and how many vehicles came to what. Its ETag leaves out ``seconds_left``."""
    view = request_views(access.session, [access.find(FleetRequest, fleet_request_id)])[0]
    conditions.offer(content_etag(content_hash(jsonable_encoder(view, exclude={"seconds_left"}))))
    return view


@router.get("/fleet-requests/{fleet_request_id}/vehicles", operation_id="fleet_requests.list_vehicles")
def list_request_vehicles(
    fleet_request_id: UUID, access: ReadAccess, window: Paging, state: Annotated[VehicleState | None, Query()] = None
) -> Page[RequestVehicleView]:
    """The vehicles of a fleet request by name, each with its state, its calibration or why there is none."""
    row = access.find(FleetRequest, fleet_request_id)
    statement = vehicles_of(row.id) if state is None else in_state(vehicles_of(row.id), state)
    rows, following = fetch(access.session, statement, FleetRequestVehicle.id, window)
    return Page(items=[vehicle_view(*row) for row in rows], next=following)


@router.post("/fleet-requests/{fleet_request_id}/cancel", status_code=202)
def cancel_fleet_request(fleet_request_id: UUID, access: WriteAccess) -> FleetRequestView:
    """Ask for the end of every vehicle that has not ended; what has ended stays as it is. [engineer]"""
    row = access.find(FleetRequest, fleet_request_id, "engineer")
    ask_all_to_end(access.session, row)
    hint(access.session, row.fleet_id, "fleet_request", row.id)
    return request_views(access.session, [row])[0]


@router.post("/fleet-requests/{fleet_request_id}/retry", status_code=202, response_model=FleetRequestView)
def retry_fleet_request(fleet_request_id: UUID, access: WriteAccess) -> JSONResponse:
    """Calibrate the failed vehicles again, each from its newest pairs; none failed, nothing changes. [engineer]"""
    row = access.find(FleetRequest, fleet_request_id, "engineer")
    retry_failed(access.session, row)
    hint(access.session, row.fleet_id, "fleet_request", row.id)
    return access.answer(request_views(access.session, [row])[0], 202)
