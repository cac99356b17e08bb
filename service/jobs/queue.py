"""Into the table and out to the broker: enqueue, release within each fleet's window, cancel, abandon."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from service.db.clock import now
from service.db.jobs import Job
from service.db.session import post
from service.jobs.history import ATTEMPT, note
from service.jobs.messages import COURIER, Message
from service.settings import get_settings

QUEUE_OF_KIND = {
    "ingest": "ingest",
    "preview": "detect",
    "suggestion": "detect",
    "detect": "detect",
    "clock_offset": "solve",
    "solve": "solve",
}
QUEUES = ("ingest", "detect", "solve", "report")
_UNENDED = ("queued", "running")


def enqueue(
    session: Session, *, kind: str, fleet_id: UUID, subject_id: UUID, payload: dict[str, Any] | None = None
) -> Job:
    """Insert one job in the caller's transaction; its message goes out after the commit."""
    return enqueue_all(session, kind=kind, fleet_id=fleet_id, subject_id=subject_id, payloads=[payload or {}])[0]


def enqueue_all(
    session: Session, *, kind: str, fleet_id: UUID, subject_id: UUID, payloads: Iterable[dict[str, Any]]
) -> list[Job]:
    """Insert several jobs of one subject; those within the fleet's window are sent after the commit."""
    queue = QUEUE_OF_KIND[kind]
    jobs = [
        Job(kind=kind, queue=queue, fleet_id=fleet_id, subject_id=subject_id, payload=payload) for payload in payloads
    ]
    session.add_all(jobs)
    session.flush()
    release(session, fleet_id, queue)
    return jobs


def release(session: Session, fleet_id: UUID, queue: str) -> None:
    """Send the fleet's oldest waiting jobs, as many as its window of sent and unclaimed ones has room for.

    The window keeps a fleet of a thousand vehicles from filling the broker's first-in, first-out queue.
    """
    settings = get_settings()
    waiting = select(Job.id).where(Job.state == "queued", Job.queue == queue, Job.fleet_id == fleet_id)
    sent = session.scalar(select(func.count()).select_from(waiting.where(Job.send_after.is_not(None)).subquery()))
    room = settings.workers + 1 - (sent or 0)
    if room <= 0:
        return
    # A common table expression, for PostgreSQL may run a plain subquery once per row, each time past its own limit.
    oldest = (
        waiting.where(Job.send_after.is_(None), ~Job.cancel_requested)
        .order_by(Job.id)
        .limit(room)
        .with_for_update(skip_locked=True)
        .cte("oldest")
    )
    released = session.execute(
        update(Job)
        .where(Job.id.in_(select(oldest.c.id)))
        .values(sends=1, send_after=now(settings.resend_s))
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    )
    for job_id in sorted(released.scalars().all()):
        post(session, COURIER, Message(job_id, queue))


def cancel(session: Session, subject_ids: Iterable[UUID]) -> None:
    """Ask for the end of these subjects' jobs. Running ones look at it with each renewal; the sweep ends the rest."""
    session.execute(
        update(Job)
        .where(Job.subject_id.in_(list(subject_ids)), Job.state.in_(_UNENDED))
        .values(cancel_requested=True)
        .execution_options(synchronize_session=False)
    )


def abandon(session: Session, subject_ids: Iterable[UUID]) -> None:
    """End these subjects' jobs because the subjects themselves are being deleted: no parent hears of it."""
    ended = session.execute(
        update(Job)
        .where(Job.subject_id.in_(list(subject_ids)), Job.state.in_(_UNENDED))
        .values(state="cancelled", finished_at=now(), lease_until=None)
        .returning(*ATTEMPT)
        .execution_options(synchronize_session=False)
    )
    for job in ended.all():
        note(session, job, "cancelled")
