"""What decides a vehicle's calibration, in one statement of look-ups by indexes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from hashlib import sha256
from typing import Any

from sqlalchemy import Select, String, Uuid, bindparam, cast, func, select
from sqlalchemy.orm import aliased

from service.platform.db.calibrations import Calibration, Publication, Result, newest_move
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.platform.db.people import Person


@cache
def state_of_vehicle(dialect: str) -> Select[*tuple[Any, ...]]:
    """A query for text and the vehicle's fleet, a row for each camera of each rig; none if there is no such vehicle.

    It takes ``vehicle`` and ``alias``. The database makes the text, so that each driver reads the same.
    """
    publisher, newest = aliased(Person), newest_move(Vehicle.id, RigCamera.name, bindparam("alias"))
    # A result that is deleted leaves its publication. A calibration's figures are known since its end; a validation
    # may change the verdict at any time.
    state = (
        *(Vehicle.id, Vehicle.version, Rig.id, Rig.version, RigCamera.name),
        *(Publication.id, Publication.result_id, Result.verdict, Calibration.finished_at, publisher.name),
    )
    text = func.json_array(*state) if dialect == "sqlite" else cast(func.json_build_array(*state), String)
    return (
        select(text, Vehicle.fleet_id)
        .select_from(Vehicle)
        .outerjoin(Rig, Rig.vehicle_id == Vehicle.id)
        .outerjoin(RigCamera, RigCamera.rig_id == Rig.id)
        .outerjoin(Publication, Publication.id == newest.correlate(Vehicle, RigCamera).scalar_subquery())
        .outerjoin(Result, Result.id == Publication.result_id)
        .outerjoin(Calibration, Calibration.id == Result.calibration_id)
        .outerjoin(publisher, publisher.id == Publication.published_by)
        .where(Vehicle.id == bindparam("vehicle", type_=Uuid()))
    )


def digest_of(rows: Iterable[str]) -> str:
    """A hash of a state. The rows are sorted here, because the statement has no ORDER BY."""
    return sha256("\n".join(sorted(rows)).encode()).hexdigest()
