"""The table of validations: a calibration tested on data that it was not fitted to."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy import BigInteger, Index, String
from sqlalchemy.orm import Mapped, mapped_column

from apexcal.documents.states import WorkState
from service.platform.db.base import Base, Created, Json, Name, RowId, belongs_to, refers_to


class Validation(Base):
    """One question and its answer. ``kind`` is ``pairs``, ``lanes`` or ``edges``.

    ``asked`` holds the calibration as it was when it was asked, so a validation outlives its result. ``single_pairs``
    are the columns of the answer with one value for each pair.
    Lists read neither ``asked`` nor ``single_pairs``.
    """

    __tablename__ = "validation"
    __table_args__ = (Index("ix_validation_vehicle_id_id", "vehicle_id", "id"),)

    id: Mapped[RowId]
    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id", index=False)
    recording_id: Mapped[UUID | None] = belongs_to("recording.id", nullable=True)
    set_id: Mapped[UUID | None] = belongs_to("correspondence_set.id", nullable=True)
    result_id: Mapped[UUID | None] = refers_to("result.id")
    kind: Mapped[str] = mapped_column(String(20))
    camera: Mapped[Name]
    asked: Mapped[Json] = mapped_column(default=dict, deferred=True)
    state: Mapped[str] = mapped_column(String(20), default=WorkState.QUEUED)
    result: Mapped[Json | None]
    single_pairs: Mapped[Json | None] = mapped_column(deferred=True)
    problem: Mapped[Json | None]
    job_id: Mapped[int | None] = mapped_column(BigInteger, index=True)
    created_at: Mapped[Created]
