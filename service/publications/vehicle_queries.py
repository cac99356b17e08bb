"""A vehicle by its name, or by the serial number of a sensor that it carries."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import ColumnElement, or_, select

from service.platform.auth.access import Access
from service.platform.db.fleets import Fleet, Rig, RigCamera, RigLidar, Vehicle
from service.platform.http.problems import conflict, not_found, unprocessable
from service.publications.mounted_sensors import carries


def vehicle_of(access: Access, name: str | None, fleet: str | None, sensor: str | None) -> Vehicle:
    """The one vehicle that fits, among those that the person may see.

    Raises:
        Problem: 422 ``vehicle_missing`` where neither name nor sensor is given; 404 ``no_such_vehicle``; 409
            ``several_vehicles``, with their ids.
    """
    if name is None and sensor is None:
        raise unprocessable(
            "vehicle_missing",
            "The request does not say whose calibration it wants.",
            "Give `vehicle`, its name, or `sensor`, the serial number of a sensor that it carries.",
        )
    statement = access.scope(select(Vehicle), Vehicle)
    if name is not None:
        statement = statement.where(_named(Vehicle, name))
    if fleet is not None:
        statement = statement.join(Fleet, Fleet.id == Vehicle.fleet_id).where(_named(Fleet, fleet))
    if sensor is not None:
        with_lidar = select(Rig.vehicle_id).join(RigLidar, RigLidar.rig_id == Rig.id)
        with_camera = select(Rig.vehicle_id).join(RigCamera, RigCamera.rig_id == Rig.id)
        statement = statement.where(
            or_(
                Vehicle.id.in_(with_lidar.where(RigLidar.serial == sensor)),
                Vehicle.id.in_(with_camera.where(RigCamera.serial == sensor)),
            )
        )
    statement = statement.order_by(Vehicle.id)
    if sensor is None:
        vehicles = access.session.scalars(statement.limit(_SHOWN + 1)).all()
    else:
        # Sensors move from vehicle to vehicle: few have ever carried this one.
        vehicles = [
            vehicle
            for vehicle in access.session.scalars(statement).all()
            if carries(access.session, vehicle.id, sensor)
        ]
    if not vehicles:
        raise not_found(
            "no_such_vehicle", "There is no such vehicle that you may see.", "Check the name or serial number."
        )
    if len(vehicles) > 1:
        ids = [str(vehicle.id) for vehicle in vehicles[:_SHOWN]]
        raise conflict(
            "several_vehicles",
            f"Several vehicles fit: {', '.join(f'{vehicle.name!r}' for vehicle in vehicles[:_SHOWN])}.",
            "Give `fleet` too, or the vehicle's id.",
            vehicles=ids,
        )
    return vehicles[0]


_SHOWN = 5


def _named(model: type[Vehicle] | type[Fleet], text: str) -> ColumnElement[bool]:
    try:
        return or_(model.name == text, model.id == UUID(text))
    except ValueError:
        return model.name == text
