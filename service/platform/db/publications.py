"""The table of publications, and where aliases lead by it."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import Index, Select, String, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from apexcal.documents.publications import CURRENT
from service.platform.db.base import Base, Created, Name, RowId, belongs_to, refers_to


class Publication(Base):
    """A move of an alias of a vehicle's camera: to which result, or nowhere; by whom, when and why.

    ``number`` counts an alias's moves from 1. The highest number says where the alias leads; no clock decides.
    ``result_id`` is null if the alias leads nowhere. Then it was withdrawn, or its result was deleted: ``led_to``
    keeps the id of a deleted result. No other column ever changes. ``overridden`` has the sentences of
    the checks that the result did not pass when it was published.
    """

    __tablename__ = "publication"
    __table_args__ = (Index("uq_publication_number", "vehicle_id", "camera", "alias", "number", unique=True),)

    id: Mapped[RowId]
    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    camera: Mapped[Name]
    alias: Mapped[str] = mapped_column(String(64))
    number: Mapped[int]
    result_id: Mapped[UUID | None] = refers_to("result.id")
    led_to: Mapped[UUID | None]
    published_by: Mapped[UUID | None] = refers_to("person.id")
    reason: Mapped[str | None] = mapped_column(String(500))
    overridden: Mapped[list[Any] | None]
    created_at: Mapped[Created]


def newest_publication(session: Session, vehicle_id: UUID, camera: str, alias: str = CURRENT) -> Publication | None:
    """The last move of an alias, also one to nowhere; None before the first."""
    return session.scalar(moves_of(vehicle_id, camera, alias).limit(1))


def current_publication(session: Session, vehicle_id: UUID, camera: str, alias: str = CURRENT) -> Publication | None:
    """The move by which an alias leads to a result now; None where it leads nowhere."""
    newest = newest_publication(session, vehicle_id, camera, alias)
    return newest if newest is not None and newest.result_id is not None else None


def moves_of(vehicle_id: UUID, camera: str, alias: str) -> Select[Publication]:
    """A query for an alias's moves, the newest first."""
    of_alias = (Publication.vehicle_id == vehicle_id, Publication.camera == camera, Publication.alias == alias)
    return select(Publication).where(*of_alias).order_by(Publication.number.desc())
