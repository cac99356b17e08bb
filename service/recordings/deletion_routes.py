"""Routes that delete rigs, vehicles and fleets of which nothing is published."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import delete, select

from service.platform.auth.access import WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.fleets import Fleet, Rig, Vehicle
from service.platform.http.problems import forbidden
from service.platform.http.router import Router
from service.recordings.actions import delete_rig, delete_vehicle

router = Router(tags=["fleets"])


@router.delete("/rigs/{id}", status_code=204)
def remove_rig(id: UUID, access: WriteAccess) -> None:
    """Delete a rig that no recording has, with its imported pairs and their calibrations. [engineer]"""
    rig = access.find(Rig, id, "engineer")
    hint(access.session, rig.fleet_id, "rig", id)
    delete_rig(access.session, rig)


@router.delete("/vehicles/{id}", status_code=204)
def remove_vehicle(id: UUID, access: WriteAccess) -> None:
    """Delete a vehicle of which nothing is published, with its rigs, recordings and calibrations. [engineer]"""
    vehicle = access.find(Vehicle, id, "engineer")
    hint(access.session, vehicle.fleet_id, "vehicle", id)
    delete_vehicle(access.session, vehicle)


@router.delete("/fleets/{id}", status_code=204)
def remove_fleet(id: UUID, access: WriteAccess) -> None:
    """Delete a fleet of which nothing is published, with its vehicles and memberships. Only an owner may."""
    fleet = access.find(Fleet, id, "admin", lock=True)
    if not access.identity.sees_all:
        raise forbidden("owner_only", "Only an owner deletes fleets.", "Ask whoever runs the service.")
    for vehicle in access.session.scalars(select(Vehicle).where(Vehicle.fleet_id == fleet.id)).all():
        delete_vehicle(access.session, vehicle)
    access.session.expunge(fleet)
    access.session.execute(delete(Fleet).where(Fleet.id == id))
