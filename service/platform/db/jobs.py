"""The job table: the only truth about work. Its times are the database's own clock."""

from __future__ import annotations

from datetime import datetime
from typing import Any
from uuid import UUID

from sqlalchemy import BigInteger, Index, Integer, String, text
from sqlalchemy.orm import Mapped, mapped_column

from apexcal.documents.states import WorkState
from service.platform.db.base import Base, Json, belongs_to, partial_index
from service.platform.db.clock import now
from service.platform.observability import request_ids

_BigId = BigInteger().with_variant(Integer, "sqlite")


# A fleet's oldest queued jobs among thousands. SQLite takes such an index only with the state as a column.
_OF_A_WINDOW = ("fleet_id", "queue", "state", "id")


class Job(Base):
    """A unit of work in one of the states queued, running, done, failed, cancelled.

    ``kind`` says what to do, ``subject_id`` to which row, ``payload`` which part of it. A queued job waits for its
    fleet's window (no ``send_after``), or is sent (``sends`` above 0; again when ``send_after`` passes unclaimed), or
    waits in backoff after a failed attempt (``sends`` is 0, until ``send_after``). Only what is sent is claimed.
    ``attempt`` counts claims, and is the fencing token of a finish; ``lost`` counts leases that ran out.
    ``request_id`` says which request caused it.
    """

    __table_args__ = (
        Index("ix_job_state_queue_fleet_id", "state", "queue", "fleet_id"),
        Index("ix_job_subject_id", "subject_id"),
        Index("ix_job_fleet_id_id", "fleet_id", "id"),
        partial_index("ix_job_waiting", *_OF_A_WINDOW, where="state = 'queued' AND send_after IS NULL"),
        partial_index("ix_job_released", *_OF_A_WINDOW, where="state = 'queued' AND sends > 0"),
        partial_index("ix_job_due", "send_after", where="state = 'queued' AND send_after IS NOT NULL"),
        partial_index("ix_job_running", "id", where="state = 'running'"),
        partial_index("ix_job_cancelled", "id", where="state = 'queued' AND IS_TRUE(cancel_requested)"),
        partial_index("ix_job_unwanted", "fleet_id", "state", "id", where="state IN ('failed', 'cancelled')"),
        partial_index("ix_job_finished_at", "finished_at", where="finished_at IS NOT NULL"),
    )

    id: Mapped[int] = mapped_column(_BigId, primary_key=True)
    fleet_id: Mapped[UUID] = belongs_to("fleet.id", index=False)
    kind: Mapped[str] = mapped_column(String(20))
    queue: Mapped[str] = mapped_column(String(20))
    subject_id: Mapped[UUID]
    payload: Mapped[Json] = mapped_column(default=dict)
    state: Mapped[str] = mapped_column(String(20), default=WorkState.QUEUED)
    attempt: Mapped[int] = mapped_column(default=0)
    lost: Mapped[int] = mapped_column(default=0)
    sends: Mapped[int] = mapped_column(default=0)
    send_after: Mapped[datetime | None]
    lease_until: Mapped[datetime | None]
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    worker: Mapped[str | None]
    progress: Mapped[Json | None]
    problem: Mapped[Json | None]
    request_id: Mapped[str | None] = mapped_column(String(request_ids.LONGEST), default=request_ids.current)
    created_at: Mapped[datetime] = mapped_column(default=now())
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]


class JobEvent(Base):
    """The end of an attempt at a job, or another event of it; an attempt under way is the job's own row.

    ``what`` is done, failed, cancelled (these end the job), lost, stumbled, given_back (it is queued again) or
    requeued (an operator started its work anew). ``tallied`` says that the totals hold it.
    """

    __table_args__ = (
        Index("ix_job_event_untallied", "id", postgresql_where=text("NOT tallied"), sqlite_where=text("tallied = 0")),
    )

    id: Mapped[int] = mapped_column(_BigId, primary_key=True)
    job_id: Mapped[int] = belongs_to("job.id")
    kind: Mapped[str] = mapped_column(String(20))
    attempt: Mapped[int]
    what: Mapped[str] = mapped_column(String(20))
    worker: Mapped[str | None]
    started_at: Mapped[datetime | None]
    at: Mapped[datetime] = mapped_column(default=now())
    reason: Mapped[str | None] = mapped_column(String(100))
    tallied: Mapped[bool] = mapped_column(default=False)


class JobTotal(Base):
    """Counts of the events of all jobs of a kind since the service began, also of jobs whose rows are gone.

    ``seconds`` sums how long the attempts took; ``buckets`` counts them by duration.
    """

    kind: Mapped[str] = mapped_column(String(20), primary_key=True)
    what: Mapped[str] = mapped_column(String(20), primary_key=True)
    count: Mapped[int] = mapped_column(BigInteger, default=0)
    seconds: Mapped[float] = mapped_column(default=0.0)
    buckets: Mapped[list[Any]] = mapped_column(default=list)


class Worker(Base):
    """A worker process that answers: its queues, how many pool processes it has, whether its kernels are compiled."""

    name: Mapped[str] = mapped_column(String(200), primary_key=True)
    queues: Mapped[str] = mapped_column(String(200))
    processes: Mapped[int]
    version: Mapped[str] = mapped_column(String(40))
    warm: Mapped[bool]
    started_at: Mapped[datetime]
    at: Mapped[datetime]


class Heartbeat(Base):
    """When something that must keep happening last happened, for example the reaper's pass."""

    name: Mapped[str] = mapped_column(String(40), primary_key=True)
    at: Mapped[datetime]
