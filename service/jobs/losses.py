"""A job that lost its worker, or what its worker needs: tried again, or given up with its reason, in one place."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.clock import now
from service.db.jobs import Job
from service.jobs.history import note
from service.jobs.parents import tell_parent
from service.settings import get_settings


def lose(session: Session, job: Job, what: str, problem: Json, after_s: float = 0.0) -> None:
    """Count a loss, ``lost`` or ``stumbled``, of a running job whose row the caller has locked.

    It is queued again and sent after ``after_s`` seconds; a cancelled one ends, and the last loss that a job may have
    ends it as failed with ``problem``.
    """
    note(session, job, what, problem)
    job.lost += 1
    job.lease_until = None
    if job.cancel_requested:
        end(session, job, "cancelled", None)
    elif job.lost >= get_settings().max_lost_leases:
        end(session, job, "failed", problem)
    else:
        job.state = "queued"
        job.sends = 0
        job.send_after = session.scalar(select(now(after_s)))


def end(session: Session, job: Job, state: str, problem: Json | None) -> None:
    """End a job that no worker finishes, and tell its parent."""
    job.state, job.problem = state, problem
    job.finished_at = session.scalar(select(now()))
    session.flush()
    note(session, job, state, problem)
    tell_parent(session, job.kind, job.subject_id, state, problem)
