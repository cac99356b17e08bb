"""The table of reports of results: one row for each result that somebody asked a report of."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from sqlalchemy import BigInteger, ForeignKey, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from apexcal.documents.states import WorkState
from service.platform.db.base import Base, Bytes, Created, Json, RowId, belongs_to


class Report(Base):
    """A result's report: how far it is, and where the newest one that was made lies, where there is one.

    ``blob_key`` and ``made_at`` are those of the last report that was made; they stay while another one is made.
    """

    __tablename__ = "report"
    __table_args__ = (UniqueConstraint("result_id"),)

    id: Mapped[RowId]
    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    result_id: Mapped[UUID] = belongs_to("result.id", index=False)
    state: Mapped[str] = mapped_column(String(20), default=WorkState.QUEUED)
    problem: Mapped[Json | None]
    job_id: Mapped[int | None] = mapped_column(BigInteger, index=True)
    blob_key: Mapped[str | None] = mapped_column(ForeignKey("blob.key"))
    size: Mapped[Bytes] = mapped_column(default=0)
    verdict: Mapped[str | None] = mapped_column(String(20))
    made_at: Mapped[datetime | None]
    created_at: Mapped[Created]
