"""Routes of fleets, vehicles and rigs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from uuid import UUID

from fastapi import Request
from fastapi.responses import JSONResponse
from sqlalchemy import select
from sqlalchemy.orm import selectinload

from apexcal.documents.fleets import CameraImages, FleetOut, Named, NewRig, RigOut, SensorSerials, VehicleOut
from apexcal.documents.publications import PublicationPolicy
from service.fleets.actions import describe
from service.fleets.rigs import rig_camera, rig_view
from service.platform.auth.access import Access, ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.base import new_id
from service.platform.db.fleets import Fleet, Rig, Vehicle
from service.platform.http.etags import Conditional, version_etag
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.problems import conflict, forbidden
from service.platform.http.router import DOCUMENT, Router
from service.platform.settings import Settings
from service.platform.storage.quota import uses

router = Router(tags=["fleets"])


@router.post("/fleets", status_code=201, response_model=FleetOut)
def post_fleet(body: Named, request: Request, access: WriteAccess) -> JSONResponse:
    """Make a fleet. Only an owner may."""
    _require_owner(access)
    _refuse_taken(access, body.name, select(Fleet.id).where(Fleet.name == body.name), "fleet")
    fleet = Fleet(id=new_id(), name=body.name, version=1)
    access.session.add(fleet)
    access.session.flush()
    return access.answer(_fleets(access, [fleet], request)[0])


@router.get("/fleets")
def get_fleets(request: Request, access: ReadAccess, paging: Paging) -> Page[FleetOut]:
    """The person's fleets."""
    rows, following = fetch(access.session, access.scope(select(Fleet), Fleet), Fleet.id, paging)
    return Page(items=_fleets(access, rows, request), next=following)


@router.get("/fleets/{id}")
def get_fleet(id: UUID, request: Request, access: ReadAccess, conditions: Conditional) -> FleetOut:
    """One fleet."""
    fleet = access.find(Fleet, id)
    conditions.offer(version_etag(fleet.version), more_changes=True)
    return _fleets(access, [fleet], request)[0]


@router.patch("/fleets/{id}")
def patch_fleet(id: UUID, body: Named, request: Request, access: WriteAccess, conditions: Conditional) -> FleetOut:
    """Rename a fleet. Only an owner may: a name that is taken would tell of a fleet of others."""
    fleet = access.find(Fleet, id, "admin", lock=True)
    _require_owner(access)
    conditions.edit(fleet)
    taken = select(Fleet.id).where(Fleet.name == body.name, Fleet.id != id)
    _refuse_taken(access, body.name, taken, "fleet")
    fleet.name = body.name
    return _fleets(access, [fleet], request)[0]


@router.post("/fleets/{id}/vehicles", status_code=201, response_model=VehicleOut)
def post_vehicle(id: UUID, body: Named, access: WriteAccess) -> JSONResponse:
    """Add a vehicle to a fleet."""
    access.find(Fleet, id, "engineer", lock=True)
    taken = select(Vehicle.id).where(Vehicle.fleet_id == id, Vehicle.name == body.name)
    _refuse_taken(access, body.name, taken, "vehicle")
    vehicle = Vehicle(id=new_id(), fleet_id=id, name=body.name, version=1)
    access.session.add(vehicle)
    access.session.flush()
    hint(access.session, id, "vehicle", vehicle.id)
    return access.answer(VehicleOut.model_validate(vehicle))


@router.get("/fleets/{id}/vehicles")
def get_vehicles(id: UUID, access: ReadAccess, paging: Paging) -> Page[VehicleOut]:
    """A fleet's vehicles."""
    access.find(Fleet, id)
    rows, following = fetch(access.session, select(Vehicle).where(Vehicle.fleet_id == id), Vehicle.id, paging)
    return Page(items=[VehicleOut.model_validate(row) for row in rows], next=following)


@router.get("/vehicles/{id}")
def get_vehicle(id: UUID, access: ReadAccess, conditions: Conditional) -> VehicleOut:
    """One vehicle."""
    vehicle = access.find(Vehicle, id)
    conditions.offer(version_etag(vehicle.version))
    return VehicleOut.model_validate(vehicle)


@router.patch("/vehicles/{id}")
def patch_vehicle(id: UUID, body: Named, access: WriteAccess, conditions: Conditional) -> VehicleOut:
    """Rename a vehicle."""
    vehicle = access.find(Vehicle, id, "engineer", lock=True)
    conditions.edit(vehicle)
    taken = select(Vehicle.id).where(
        Vehicle.fleet_id == vehicle.fleet_id, Vehicle.name == body.name, Vehicle.id != id
    )
    _refuse_taken(access, body.name, taken, "vehicle")
    vehicle.name = body.name
    return VehicleOut.model_validate(vehicle)


@router.post("/vehicles/{id}/rigs", status_code=201, response_model=RigOut, max_body_size=DOCUMENT)
def post_rig(id: UUID, body: NewRig, access: WriteAccess) -> JSONResponse:
    """Describe what a vehicle carries: one LiDAR and its cameras."""
    vehicle = access.find(Vehicle, id, "engineer", lock=True)
    taken = select(Rig.id).where(Rig.vehicle_id == id, Rig.name == body.name)
    _refuse_taken(access, body.name, taken, "rig")
    rig = Rig(id=new_id(), fleet_id=vehicle.fleet_id, vehicle_id=id, name=body.name, version=1)
    describe(rig, body)
    access.session.add(rig)
    access.session.flush()
    return access.answer(rig_view(rig))


@router.get("/vehicles/{id}/rigs")
def get_rigs(id: UUID, access: ReadAccess, paging: Paging) -> Page[RigOut]:
    """A vehicle's rigs."""
    access.find(Vehicle, id)
    statement = select(Rig).where(Rig.vehicle_id == id).options(selectinload(Rig.lidars), selectinload(Rig.cameras))
    rows, following = fetch(access.session, statement, Rig.id, paging)
    return Page(items=[rig_view(row) for row in rows], next=following)


@router.get("/rigs/{id}")
def get_rig(id: UUID, access: ReadAccess, conditions: Conditional) -> RigOut:
    """One rig."""
    rig = access.find(Rig, id)
    conditions.offer(version_etag(rig.version))
    return rig_view(rig)


@router.patch("/rigs/{id}/serials")
def patch_serials(id: UUID, body: SensorSerials, access: WriteAccess, conditions: Conditional) -> RigOut:
    """Correct or complete the serial numbers of a rig's sensors; those omitted stay. [engineer]

    A swapped sensor needs a new rig.
    """
    rig = access.find(Rig, id, "engineer", lock=True)
    conditions.edit(rig)
    if "lidar" in body.model_fields_set:
        rig.lidar.serial = body.lidar
    for name, serial in body.cameras.items():
        rig_camera(access.session, rig, name).serial = serial
    access.session.flush()
    return rig_view(rig)


@router.patch("/rigs/{id}/images")
def patch_images(id: UUID, body: CameraImages, access: WriteAccess, conditions: Conditional) -> RigOut:
    """Correct whether a rig's cameras give raw or rectified images; cameras omitted stay. [engineer]

    The lens that a recording states, and the frame of exports, follow from it. Marks and results stay.
    """
    rig = access.find(Rig, id, "engineer", lock=True)
    conditions.edit(rig)
    for name, images in body.cameras.items():
        rig_camera(access.session, rig, name).images = images and images.model_dump(mode="json")
    access.session.flush()
    return rig_view(rig)


@router.put("/rigs/{id}/policy")
def put_rig_policy(id: UUID, body: PublicationPolicy, access: WriteAccess, conditions: Conditional) -> RigOut:
    """State what this rig's results must show to be published; `{}` states nothing. [admin]"""
    rig = access.find(Rig, id, "admin", lock=True)
    conditions.edit(rig)
    rig.policy = body.model_dump(exclude_none=True) or None
    return rig_view(rig)


@router.put("/fleets/{id}/policy")
def put_fleet_policy(
    id: UUID, body: PublicationPolicy, request: Request, access: WriteAccess, conditions: Conditional
) -> FleetOut:
    """State what all results of the fleet must show to be published; `{}` states nothing. [admin]"""
    fleet = access.find(Fleet, id, "admin", lock=True)
    conditions.edit(fleet)
    fleet.policy = body.model_dump(exclude_none=True) or None
    return _fleets(access, [fleet], request)[0]


def _fleets(access: Access, fleets: Sequence[Fleet], request: Request) -> list[FleetOut]:
    settings: Settings = request.app.state.settings
    use = uses(access.session, fleets, settings.fleet_quota_bytes)
    return [
        FleetOut.of(
            fleet,
            role=access.role(fleet.id),
            taken_bytes=use[fleet.id].taken,
            row_bytes=use[fleet.id].rows,
            quota_bytes=use[fleet.id].allowed,
        )
        for fleet in fleets
    ]


def _require_owner(access: Access) -> None:
    if not access.identity.sees_all:
        raise forbidden("owner_only", "Only an owner names fleets.", "Ask whoever runs the service.")


def _refuse_taken(access: Access, name: str, statement: Any, what: str) -> None:
    if access.session.scalar(statement.limit(1)) is not None:
        raise conflict("name_taken", f"There is a {what} named {name!r} already.", "Choose another name.")
