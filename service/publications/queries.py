"""Queries of aliases, publications and withdrawals."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import ColumnElement, Select, and_, bindparam, exists, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.platform.db.base import lasting_alias
from service.platform.db.calibrations import Publication, Result, moves_of

# Made once: they would take a tenth of what the end of a calibration costs.
_LATER, _NEXT = lasting_alias(Publication, "later"), lasting_alias(Publication, "following")
_IS_NEXT = and_(
    *(_NEXT.vehicle_id == Publication.vehicle_id, _NEXT.camera == Publication.camera),
    *(_NEXT.alias == Publication.alias, _NEXT.number == Publication.number + 1, _NEXT.led_to.is_(None)),
)
_WITHDRAWALS = (
    select(Publication.result_id, _NEXT)
    .outerjoin(_NEXT, _IS_NEXT)
    .where(Publication.result_id.in_(bindparam("results", expanding=True)), Publication.alias == CURRENT)
    .order_by(Publication.number)
)


def newest_publications(vehicle_id: UUID, camera: str) -> Select[Publication]:
    """A query for the last move of each alias of a camera, by name; includes aliases that lead nowhere now."""
    of_camera = (Publication.vehicle_id == vehicle_id, Publication.camera == camera)
    return select(Publication).where(*of_camera, is_newest()).order_by(Publication.alias)


def aliases_to(session: Session, vehicle_id: UUID, calibrations: Sequence[UUID]) -> list[tuple[str, str]]:
    """The aliases that lead to a result of one of these calibrations, each with its camera."""
    rows = session.execute(
        select(Publication.alias, Publication.camera)
        .join(Result, Result.id == Publication.result_id)
        .where(Publication.vehicle_id == vehicle_id, Result.calibration_id.in_(calibrations), is_newest())
        .order_by(Publication.camera, Publication.alias)
    )
    return [(alias, camera) for alias, camera in rows]


def was_published(session: Session, result: Result, alias: str) -> bool:
    """Whether the alias ever led to this result."""
    earlier = (Publication.result_id == result.id, Publication.alias == alias)
    return session.scalar(select(Publication.id).where(*earlier).limit(1)) is not None


def withdrawal_of(session: Session, publication: Publication) -> Publication | None:
    """The move to nowhere right after this one, or None."""
    number = publication.number + 1
    of_alias = moves_of(publication.vehicle_id, publication.camera, publication.alias)
    return session.scalar(of_alias.where(Publication.number == number, Publication.led_to.is_(None)))


def withdrawals(session: Session, result_ids: Sequence[UUID]) -> list[tuple[UUID, Publication | None]]:
    """Each time that `current` led to one of these results, oldest first: the result's id, and its withdrawal."""
    rows = session.execute(_WITHDRAWALS, {"results": list(result_ids)})
    return [(result_id, withdrawal) for result_id, withdrawal in rows if result_id is not None]


def is_newest() -> ColumnElement[bool]:
    """Whether a publication is the last move of its alias."""
    of_alias = (_LATER.vehicle_id == Publication.vehicle_id, _LATER.camera == Publication.camera)
    return ~exists().where(*of_alias, _LATER.alias == Publication.alias, _LATER.number > Publication.number)
