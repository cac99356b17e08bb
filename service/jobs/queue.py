"""Into the table and out to the broker: enqueue, release within each fleet's window, cancel, abandon."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from sqlalchemy import Select, func, literal, select, update
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
    # Not behind a fleet's waiting runs: it is a moment's work, and a calibration ends with it.
    "consistency": "report",
}
QUEUES = ("ingest", "detect", "solve", "report")
_UNENDED = ("queued", "running")
# Written out in the statement: a partial index is not found by a parameter's value.
_QUEUED = Job.state == literal("queued", literal_execute=True)


def enqueue(
    session: Session, *, kind: str, fleet_id: UUID, subject_id: UUID, payload: dict[str, Any] | None = None
) -> Job:
    """Insert one job in the caller's transaction; its message goes out after the commit."""
    return enqueue_all(session, kind=kind, fleet_id=fleet_id, subject_id=subject_id, payloads=[payload or {}])[0]


def enqueue_all(
    session: Session, *, kind: str, fleet_id: UUID, subject_id: UUID, payloads: Iterable[dict[str, Any]]
) -> list[Job]:
    """Insert several jobs of one subject; those within the fleet's window are sent after the commit."""
    return enqueue_each(session, kind=kind, fleet_id=fleet_id, work=[(subject_id, payload) for payload in payloads])


def enqueue_each(
    session: Session, *, kind: str, fleet_id: UUID, work: Iterable[tuple[UUID, dict[str, Any]]]
) -> list[Job]:
    """The same for several subjects, each with its payload."""
    queue = QUEUE_OF_KIND[kind]
    jobs = [
        Job(kind=kind, queue=queue, fleet_id=fleet_id, subject_id=subject_id, payload=payload)
        for subject_id, payload in work
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
    queued = select(Job.id).where(_QUEUED, Job.queue == queue, Job.fleet_id == fleet_id)
    # At most a window's worth is sent and unclaimed, but whoever counts stops there.
    sent = queued.where(Job.send_after.is_not(None)).limit(settings.workers + 1).subquery()
    room = settings.workers + 1 - (session.scalar(select(func.count()).select_from(sent)) or 0)
    if room <= 0:
        return
    # A common table expression, for PostgreSQL may run a plain subquery once per row, each time past its own limit.
    oldest = (
        queued.where(Job.send_after.is_(None), ~Job.cancel_requested)
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


def cancel(session: Session, subjects: Iterable[UUID] | Select[UUID]) -> None:
    """Ask for the end of these subjects' jobs. Running ones look at it with each renewal; the sweep ends the rest."""
    session.execute(
        update(Job)
        .where(Job.subject_id.in_(subjects if isinstance(subjects, Select) else list(subjects)))
        .where(Job.state.in_(_UNENDED), ~Job.cancel_requested)
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
