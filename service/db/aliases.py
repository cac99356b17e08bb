"""Tables of withdrawals, and of the moves of aliases other than ``current``."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from sqlalchemy import Index, String
from sqlalchemy.orm import Mapped, mapped_column

from service.db.base import Base, Created, Json, Name, RowId, belongs_to, refers_to


class Withdrawal(Base):
    """A publication that must no longer be used: withdrawn by whom, when and why. Rows never change.

    ``number`` is the publication's. The camera is given nothing until there is a publication with a higher number,
    even if the withdrawn one is deleted meanwhile.
    """

    __tablename__ = "withdrawal"
    __table_args__ = (Index("uq_withdrawal_vehicle_id_camera_number", "vehicle_id", "camera", "number", unique=True),)

    id: Mapped[RowId]
    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    camera: Mapped[Name]
    number: Mapped[int]
    said_by: Mapped[UUID | None] = refers_to("person.id")
    reason: Mapped[str] = mapped_column(String(500))
    created_at: Mapped[Created]


class AliasMove(Base):
    """One move of a camera's alias: by whom, when, why, and to which result. Rows never change.

    ``number`` counts the alias's moves from 1; the highest says where it is. ``result_id`` is null if the alias was
    removed or its result was deleted; ``led_to`` keeps the id of a deleted result. ``overridden`` and ``gate``
    are as of a publication.
    """

    __tablename__ = "alias_move"
    __table_args__ = (Index("uq_alias_move_newness", "vehicle_id", "camera", "alias", "number", unique=True),)

    id: Mapped[RowId]
    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    camera: Mapped[Name]
    alias: Mapped[str] = mapped_column(String(64))
    number: Mapped[int]
    result_id: Mapped[UUID | None] = refers_to("result.id")
    led_to: Mapped[UUID | None]
    overridden: Mapped[list[Any] | None]
    gate: Mapped[Json | None]
    said_by: Mapped[UUID | None] = refers_to("person.id")
    reason: Mapped[str] = mapped_column(String(500))
    created_at: Mapped[Created]
