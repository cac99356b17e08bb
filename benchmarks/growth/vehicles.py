"""Many vehicles with pairs, copied in the database from one that was brought as clients do it."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from benchmarks.house import House
from benchmarks.vehicles import bring, draw
from service.platform.db.base import Base, new_id
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.fleets import Rig, RigCamera, RigLidar, Vehicle, natural_order

_AT_ONCE = 500


def bring_many(house: House, fleet_id: UUID, count: int, seed: int) -> None:
    """Bring so many vehicles, each with one camera of 222 pairs."""
    bring(house.client, fleet_id, draw(1, seed))
    with house.database.writing() as session:
        vehicle = session.scalars(select(Vehicle).where(Vehicle.fleet_id == fleet_id)).one()
        rig = session.scalars(select(Rig).where(Rig.vehicle_id == vehicle.id)).one()
        camera = session.scalars(select(RigCamera).where(RigCamera.rig_id == rig.id)).one()
        pairs = session.scalars(select(CorrespondenceSet).where(CorrespondenceSet.rig_id == rig.id)).one()
        _ = pairs.pairs
        originals = [_values(row) for row in (vehicle, rig, rig.lidar, camera, pairs)]
    for first in range(1, count, _AT_ONCE):
        with house.database.writing() as session:
            _copy(session, originals, range(first, min(first + _AT_ONCE, count)))


def _values(row: Base) -> dict[str, Any]:
    return {column.key: getattr(row, column.key) for column in type(row).__mapper__.column_attrs}


def _copy(session: Session, originals: list[dict[str, Any]], numbers: range) -> None:
    vehicle, rig, lidar, camera, pairs = originals
    rows: list[list[dict[str, Any]]] = [[], [], [], [], []]
    for number in numbers:
        name = f"vehicle {number:06d}"
        vehicle_id, rig_id = new_id(), new_id()
        rows[0].append(vehicle | {"id": vehicle_id, "name": name, "sort_name": natural_order(name)})
        rows[1].append(rig | {"id": rig_id, "vehicle_id": vehicle_id})
        rows[2].append(lidar | {"id": new_id(), "rig_id": rig_id})
        rows[3].append(camera | {"id": new_id(), "rig_id": rig_id})
        rows[4].append(pairs | {"id": new_id(), "vehicle_id": vehicle_id, "rig_id": rig_id})
    for table, values in zip((Vehicle, Rig, RigLidar, RigCamera, CorrespondenceSet), rows, strict=True):
        session.execute(insert(table), values)
