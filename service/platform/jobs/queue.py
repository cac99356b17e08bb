"""Into the table and out to the broker: enqueue, release within each fleet's window, cancel, abandon.

A retry starts failed work again from its beginning, with fresh jobs, in one transaction. The failed job keeps its
history, and the results are the same as a first try's.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import (
    ColumnElement,
    Integer,
    ScalarSelect,
    Select,
    SelectBase,
    String,
    Update,
    bindparam,
    case,
    exists,
    func,
    literal,
    literal_column,
    select,
    update,
)
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.platform.db.base import Json, state_literal
from service.platform.db.clock import now, now_plus
from service.platform.db.fleets import Fleet
from service.platform.db.jobs import Job, Worker
from service.platform.db.session import post
from service.platform.jobs.history import ATTEMPT, note
from service.platform.jobs.kinds import CannotRetryError, kind_of
from service.platform.jobs.messages import COURIER, Message
from service.platform.jobs.queues import FLEET_CAPS
from service.platform.settings import get_settings

# Nobody else releases jobs of a capped queue meanwhile. This row is locked last, so that there is no deadlock.
_HOLD_FLEET = select(Fleet.id).where(Fleet.id == bindparam("fleet")).with_for_update(key_share=True)


# A worker's heartbeat comes every 2 s, or 5 s if the database answers slowly.
SILENT_S = 8.0
# At least two jobs are sent always, so that a starting worker finds work before its first heartbeat.
_FEWEST = 2


def answers() -> ColumnElement[bool]:
    """Return whether a worker's heartbeat came within `SILENT_S`; it comes while the worker compiles, too."""
    return Worker.at.between(now(-SILENT_S), now())


def _processes(queue: Any) -> ScalarSelect[int]:
    takes = ("," + Worker.queues + ",").like("%," + queue + ",%")
    return select(func.coalesce(func.sum(Worker.processes), 0)).where(answers(), takes).scalar_subquery()


def live_processes(session: Session, queue: str) -> int:
    """Pool processes of all workers that answer and take this queue; never less than are sent for in any case."""
    return max(_FEWEST, session.scalars(select(_processes(literal(queue)))).one())


def _releasing(*, capped: bool) -> Update:
    """Marks a fleet's oldest waiting jobs as sent, as far as its window has room, and returns their ids.

    ``capped``: the window is given, and running jobs take room too. Otherwise one job waits for each process, and
    none is idle while the next is sent. More would only delay the other fleets.
    """
    queue = bindparam("of_queue", type_=String())
    live = _processes(queue)
    window: ColumnElement[int] = (
        bindparam("window", type_=Integer()) if capped else case((live > _FEWEST, live), else_=_FEWEST)
    )
    mine = select(Job.id).where(Job.queue == queue, Job.fleet_id == bindparam("fleet"))
    queued = mine.where(Job.state == state_literal(WorkState.QUEUED))
    # At most a window's worth is sent and unclaimed; counting stops there.
    room = window - _count(queued.where(Job.sends > literal_column("0")).limit(window))
    if capped:
        room -= _count(mine.where(Job.state == state_literal(WorkState.RUNNING)))
    # A common table expression, for PostgreSQL may run a plain subquery once per row, each time past its own limit.
    oldest = (
        queued.where(Job.send_after.is_(None), ~Job.cancel_requested)
        .order_by(Job.id)
        .limit(case((room > 0, room), else_=0))
        .with_for_update(skip_locked=True)
        .cte("oldest")
    )
    return (
        update(Job)
        .where(Job.id.in_(select(oldest.c.id)))
        .values(sends=1, send_after=now_plus("resend_s"))
        .returning(Job.id, Job.kind)
    )


def _count(ids: Select[int]) -> ScalarSelect[int]:
    return select(func.count()).select_from(ids.subquery()).scalar_subquery()


_RELEASE = _releasing(capped=False)
_RELEASE_CAPPED = _releasing(capped=True)


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
    """Queue jobs of several subjects, each with its payload."""
    queue = kind_of(kind).queue
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

    The window keeps a fleet of a thousand vehicles from filling the broker's first-in, first-out queue. On a capped
    queue it also holds those that run: only what was sent is claimed, so no more than the cap ever run.
    """
    settings = get_settings()
    cap = FLEET_CAPS.get(queue)
    window = {"fleet": fleet_id, "of_queue": queue, "resend_s": settings.resend_s}
    connection = session.connection()
    if cap:
        window["window"] = getattr(settings, cap)
        connection.execute(_HOLD_FLEET, {"fleet": fleet_id})
    released = connection.execute(_RELEASE_CAPPED if cap else _RELEASE, window)
    for job_id, kind in sorted(released.all()):
        post(session, COURIER, Message(job_id, kind))


def cancel(session: Session, subjects: Sequence[UUID] | SelectBase) -> None:
    """Ask for the end of these subjects' jobs. Running ones see it at each renewal; the reaper ends the rest."""
    unended = select(Job.id).where(Job.subject_id.in_(subjects), Job.state.in_(UNENDED), ~Job.cancel_requested)
    # Whoever ends a job that this waits for may have queued the next one of its work. None follows a flagged one.
    while session.scalar(unended.limit(1)) is not None:
        flagged = unended.order_by(Job.id).with_for_update().cte("flagged")
        session.execute(update(Job).where(Job.id.in_(select(flagged.c.id))).values(cancel_requested=True))


def end_jobs(session: Session, jobs: Select[int], state: WorkState, problem: Json | None = None) -> Sequence[Any]:
    """End the jobs of a query that locks them by their ids. Return kind and subject of each, which hear nothing."""
    ended = session.execute(
        update(Job)
        .where(Job.id.in_(select(jobs.cte("ending").c.id)))
        .values(state=state, problem=problem, finished_at=now(), lease_until=None)
        .returning(*ATTEMPT, Job.subject_id)
    ).all()
    note(session, ended, state, problem)
    return ended


def abandon(session: Session, subject_ids: Sequence[UUID]) -> None:
    """End these subjects' jobs because the subjects themselves are being deleted, so none hears of it."""
    unended = select(Job.id).where(Job.subject_id.in_(subject_ids), Job.state.in_(UNENDED))
    # In one order: two deletions may share jobs.
    end_jobs(session, unended.order_by(Job.id).with_for_update(), WorkState.CANCELLED)


def retry(session: Session, job_id: int) -> Sequence[Job]:
    """Start a failed job's work anew and return the fresh jobs. Raises :class:`CannotRetryError`."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is None:
        raise CannotRetryError(f"there is no job {job_id}")
    if job.state != WorkState.FAILED:
        raise CannotRetryError(f"job {job_id} is {job.state}; only failed ones are started again")
    again = kind_of(job.kind).retry
    if again is None:
        raise CannotRetryError(f"work of the kind {job.kind} is not started again by itself; ask for it anew")
    under_way = exists().where(Job.subject_id == job.subject_id, Job.state.in_(UNENDED))
    if session.scalar(select(under_way)):
        raise CannotRetryError("other jobs of the same work are under way; wait for their end")
    fresh = again(session, job)
    note(session, [job], "requeued", job.problem)
    return fresh


def answering_workers(session: Session) -> Sequence[Worker]:
    """Return the workers that answer."""
    return session.scalars(select(Worker).where(answers())).all()
