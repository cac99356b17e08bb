"""A camera's current calibration is its newest publication; this makes and finds publications.

Publishing and deleting both lock the calibration's row and then the vehicle's until the commit. So of two at the
same moment the second sees what the first did.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import ColumnElement, Select, func, select
from sqlalchemy.orm import Session

from service.db.calibrations import NEWNESS, Calibration, Publication, Result
from service.db.fleets import Vehicle

_BY_ITSELF = "It was recommended and had no objections."


class Words(NamedTuple):
    """Who publishes and why; ``overridden`` is what speaks against it, where it is published all the same."""

    person_id: UUID | None
    reason: str | None
    overridden: Sequence[str] = ()


def hold_publications(session: Session, vehicle_id: UUID) -> None:
    """Let nobody else publish for this vehicle until the commit. Calibrations are locked before it."""
    session.execute(select(Vehicle.id).where(Vehicle.id == vehicle_id).with_for_update(key_share=True))


def hold_to_publish(session: Session, result: Result) -> Calibration | None:
    """The result's calibration, held with the vehicle's publications. None where it was deleted meanwhile."""
    calibration = session.get(Calibration, result.calibration_id, with_for_update={"key_share": True})
    if calibration is not None:
        hold_publications(session, calibration.vehicle_id)
    return calibration


def current_publication(session: Session, vehicle_id: UUID, camera: str) -> Publication | None:
    """What the camera is given now, or None."""
    return session.scalar(_newest_first(vehicle_id, camera).limit(1))


def current_id(vehicle_id: UUID, camera: str) -> Select[UUID]:
    """A query for the id of what one camera is given now."""
    return _newest_first(vehicle_id, camera).with_only_columns(Publication.id).limit(1)


def current_ids(*of: ColumnElement[bool]) -> Select[UUID]:
    """A query for the ids of what cameras are given now. ``of`` limits it to some vehicles or fleets."""
    age = func.row_number().over(
        partition_by=(Publication.vehicle_id, Publication.camera), order_by=[key.desc() for key in NEWNESS]
    )
    ranked = select(Publication.id, age.label("age")).where(*of).subquery()
    return select(ranked.c.id).where(ranked.c.age == 1)


def was_given(session: Session, result: Result) -> bool:
    """Whether the result has been published before."""
    return session.scalar(select(Publication.id).where(Publication.result_id == result.id).limit(1)) is not None


def publish(session: Session, calibration: Calibration, result: Result, words: Words) -> Publication:
    """Give a result to its camera. The caller holds the vehicle's publications."""
    row = Publication(
        fleet_id=calibration.fleet_id,
        vehicle_id=calibration.vehicle_id,
        camera=result.camera,
        result_id=result.id,
        number=_next_number(session, calibration.vehicle_id, result.camera),
        published_by=words.person_id,
        reason=words.reason,
        overridden=list(words.overridden) or None,
    )
    session.add(row)
    session.flush()
    return row


def publish_by_itself(session: Session, calibration: Calibration, result: Result) -> None:
    """Give a recommended result to its camera in the name of who asked for it."""
    publish(session, calibration, result, Words(calibration.created_by, _BY_ITSELF))


def _next_number(session: Session, vehicle_id: UUID, camera: str) -> int:
    """One more than the newest has, after rows without a number have got theirs."""
    publications = _newest_first(vehicle_id, camera)
    newest = session.scalar(publications.where(Publication.number.is_not(None)).limit(1))
    last = newest.number or 0 if newest else 0
    for row in reversed(session.scalars(publications.where(Publication.number.is_(None))).all()):
        last += 1
        row.number = last
    return last + 1


def _newest_first(vehicle_id: UUID, camera: str) -> Select[Publication]:
    of_camera = select(Publication).where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
    return of_camera.order_by(*(key.desc() for key in NEWNESS))
