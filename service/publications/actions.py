"""Moving aliases: publishing a result, and withdrawing one.

Publishing and deleting both lock the calibration's row and then the vehicle's until the commit. So of two at the
same moment the second sees what the first did.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.platform.db.calibrations import Calibration, Publication, Result, newest_publication
from service.platform.db.fleets import Vehicle
from service.publications.queries import newest_publications

_PASSED = "It was recommended and passed its checks."
PUBLISHED_LOOKS = "It was recommended, and the publication policy publishes results of `look`."


class Grounds(NamedTuple):
    """The person who moves an alias, and why. ``overridden``: sentences of checks that the result does not pass."""

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


def publish(
    session: Session, calibration: Calibration, result: Result, grounds: Grounds, alias: str = CURRENT
) -> Publication:
    """Let an alias of the result's camera lead to it. The caller holds the vehicle's publications."""
    newest = newest_publication(session, calibration.vehicle_id, result.camera, alias)
    row = Publication(
        fleet_id=calibration.fleet_id,
        vehicle_id=calibration.vehicle_id,
        camera=result.camera,
        alias=alias,
        number=newest.number + 1 if newest else 1,
        result_id=result.id,
        led_to=result.id,
        published_by=grounds.person_id,
        reason=grounds.reason,
        overridden=list(grounds.overridden) or None,
    )
    session.add(row)
    session.flush()
    return row


def publish_by_itself(session: Session, calibration: Calibration, result: Result, overridden: Sequence[str]) -> None:
    """Give a recommended result to its camera in the name of who asked for it. ``overridden``: checks of `look`."""
    reason = PUBLISHED_LOOKS if overridden else _PASSED
    publish(session, calibration, result, Grounds(calibration.created_by, reason, overridden))


def withdraw(session: Session, publication: Publication, grounds: Grounds) -> Publication:
    """Let an alias that leads to a result lead nowhere; for `current`, all aliases that lead to the same result.

    The caller holds the vehicle's publications, and has made sure that ``publication`` is its alias's last move.
    """
    moves = [publication]
    if publication.alias == CURRENT:
        others = newest_publications(publication.vehicle_id, publication.camera).where(
            Publication.result_id == publication.result_id, Publication.alias != CURRENT
        )
        moves += session.scalars(others)
    rows = [
        Publication(
            fleet_id=move.fleet_id,
            vehicle_id=move.vehicle_id,
            camera=move.camera,
            alias=move.alias,
            number=move.number + 1,
            published_by=grounds.person_id,
            reason=grounds.reason,
        )
        for move in moves
    ]
    session.add_all(rows)
    session.flush()
    return rows[0]
