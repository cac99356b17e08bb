"""A camera's current calibration is its newest publication; this makes, withdraws and finds publications.

Publishing and deleting both lock the calibration's row and then the vehicle's until the commit. So of two at the
same moment the second sees what the first did.
"""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import ColumnElement, Select, func, select
from sqlalchemy.orm import Session

from service.calibration_runs.alias_actions import OfCamera, Words, move_alias, newest_moves
from service.calibration_runs.gate_verdicts import gate_verdict
from service.db.aliases import Withdrawal
from service.db.calibrations import NEWNESS, Calibration, Publication, Result
from service.db.fleets import Vehicle

_BY_ITSELF = "It was recommended and had no objections."


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
        gate=gate_verdict(session, result),
    )
    session.add(row)
    session.flush()
    return row


def withdrawal_of(session: Session, publication: Publication) -> Withdrawal | None:
    """The withdrawal of this publication, or None."""
    if publication.number is None:
        return None
    return session.scalar(
        select(Withdrawal).where(
            Withdrawal.vehicle_id == publication.vehicle_id,
            Withdrawal.camera == publication.camera,
            Withdrawal.number == publication.number,
        )
    )


def is_withdrawn(session: Session, publication: Publication) -> bool:
    """Whether this newest publication is withdrawn, so that the camera has nothing."""
    last = _last_withdrawn(session, publication.vehicle_id, publication.camera)
    return publication.number is not None and publication.number <= last


def withdraw(session: Session, publication: Publication, person_id: UUID, reason: str) -> Withdrawal:
    """Take a publication back; aliases that lead to its result are taken away too.

    The caller holds the vehicle's publications, and has made sure that it is not withdrawn yet.
    """
    _number_all(session, publication.vehicle_id, publication.camera)
    assert publication.number is not None
    of = OfCamera(publication.fleet_id, publication.vehicle_id, publication.camera)
    row = Withdrawal(**of._asdict(), number=publication.number, said_by=person_id, reason=reason)
    session.add(row)
    for move in newest_moves(session, publication.vehicle_id, publication.camera):
        if move.result_id == publication.result_id:
            move_alias(session, of, move.alias, None, Words(person_id, reason))
    session.flush()
    return row


def publish_by_itself(session: Session, calibration: Calibration, result: Result) -> None:
    """Give a recommended result to its camera in the name of who asked for it."""
    publish(session, calibration, result, Words(calibration.created_by, _BY_ITSELF))


def _next_number(session: Session, vehicle_id: UUID, camera: str) -> int:
    """One more than the number of the newest publication or withdrawal."""
    return _number_all(session, vehicle_id, camera) + 1


def _last_withdrawn(session: Session, vehicle_id: UUID, camera: str) -> int:
    of_camera = (Withdrawal.vehicle_id == vehicle_id, Withdrawal.camera == camera)
    return session.scalar(select(func.max(Withdrawal.number)).where(*of_camera)) or 0


def _number_all(session: Session, vehicle_id: UUID, camera: str) -> int:
    """Number the rows that have no number. Returns the highest number, of withdrawn rows too; 0 if there is none."""
    publications = _newest_first(vehicle_id, camera)
    newest = session.scalar(publications.where(Publication.number.is_not(None)).limit(1))
    # A number of what was withdrawn and deleted since is free no more: it says that its row was withdrawn.
    last = max(newest.number or 0 if newest else 0, _last_withdrawn(session, vehicle_id, camera))
    for row in reversed(session.scalars(publications.where(Publication.number.is_(None))).all()):
        last += 1
        row.number = last
    return last


def _newest_first(vehicle_id: UUID, camera: str) -> Select[Publication]:
    of_camera = select(Publication).where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
    return of_camera.order_by(*(key.desc() for key in NEWNESS))
