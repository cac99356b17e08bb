"""The job table: the only truth about work. Its times are the database's own clock."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from sqlalchemy import BigInteger, Index, Integer, String
from sqlalchemy.orm import Mapped, mapped_column

from service.db.base import Base, Json, belongs_to
from service.db.clock import now


class Job(Base):
    """A unit of work in one of the states queued, running, done, failed, cancelled.

    ``kind`` says what to do, ``subject_id`` to which row, ``payload`` which part of it. A job is sent when
    ``send_after`` is set; it is sent again when that moment passes unclaimed. ``attempt`` counts claims, and is
    the fencing token of a finish; ``lost`` counts leases that ran out.
    """

    __tablename__ = "job"
    __table_args__ = (
        Index("ix_job_state_queue_fleet_id", "state", "queue", "fleet_id"),
        Index("ix_job_subject_id", "subject_id"),
    )

    id: Mapped[int] = mapped_column(BigInteger().with_variant(Integer, "sqlite"), primary_key=True)
    fleet_id: Mapped[UUID] = belongs_to("fleet.id", index=False)
    kind: Mapped[str] = mapped_column(String(20))
    queue: Mapped[str] = mapped_column(String(20))
    subject_id: Mapped[UUID]
    payload: Mapped[Json] = mapped_column(default=dict)
    state: Mapped[str] = mapped_column(String(20), default="queued")
    attempt: Mapped[int] = mapped_column(default=0)
    lost: Mapped[int] = mapped_column(default=0)
    sends: Mapped[int] = mapped_column(default=0)
    send_after: Mapped[datetime | None]
    lease_until: Mapped[datetime | None]
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    worker: Mapped[str | None]
    progress: Mapped[Json | None]
    problem: Mapped[Json | None]
    created_at: Mapped[datetime] = mapped_column(default=now())
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]


class Heartbeat(Base):
    """When something that must keep happening last happened, for example the sweep."""

    __tablename__ = "heartbeat"

    name: Mapped[str] = mapped_column(String(40), primary_key=True)
    at: Mapped[datetime]
