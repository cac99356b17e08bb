"""Version of, and access to, a vehicle's calibration, in one statement of look-ups by indexes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from hashlib import sha256

from sqlalchemy import Select, String, Uuid, and_, bindparam, cast, func, or_, select
from sqlalchemy.orm import aliased

from service.platform.db.calibrations import Calibration, Publication, Result, newest_move
from service.platform.db.clock import now
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.platform.db.people import ApiToken, Membership, Person


@cache
def state_of_vehicle(dialect: str) -> Select[str]:
    """A query for a row of text for each camera of each rig; none if there is no such vehicle.

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
        select(text)
        .select_from(Vehicle)
        .outerjoin(Rig, Rig.vehicle_id == Vehicle.id)
        .outerjoin(RigCamera, RigCamera.rig_id == Rig.id)
        .outerjoin(Publication, Publication.id == newest.correlate(Vehicle, RigCamera).scalar_subquery())
        .outerjoin(Result, Result.id == Publication.result_id)
        .outerjoin(Calibration, Calibration.id == Result.calibration_id)
        .outerjoin(publisher, publisher.id == Publication.published_by)
        .where(Vehicle.id == bindparam("vehicle", type_=Uuid()))
    )


@cache
def state_for_token(dialect: str) -> Select[str]:
    """Select the state if the API token with the hash ``secret`` may see the vehicle, else no row."""
    lasts = or_(ApiToken.expires_at.is_(None), ApiToken.expires_at > now())
    in_fleet = and_(Membership.person_id == Person.id, Membership.fleet_id == Vehicle.fleet_id)
    return (
        state_of_vehicle(dialect)
        .join(ApiToken, and_(ApiToken.secret_hash == bindparam("secret"), ApiToken.revoked_at.is_(None), lasts))
        .join(Person, Person.id == ApiToken.person_id)
        .outerjoin(Membership, in_fleet)
        .where(
            or_(ApiToken.fleet_id.is_(None), ApiToken.fleet_id == Vehicle.fleet_id),
            or_(Person.is_owner, Membership.role.is_not(None)),
        )
    )


def digest_of(rows: Iterable[str]) -> str | None:
    """A hash of a state; None without rows. The rows are sorted here, because the statements have no ORDER BY."""
    texts = sorted(rows)
    return sha256("\n".join(texts).encode()).hexdigest() if texts else None
