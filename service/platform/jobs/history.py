"""What became of each attempt at a job: one row, written in the transaction in which it happens."""

from __future__ import annotations

from typing import Any

from sqlalchemy import bindparam, insert
from sqlalchemy.orm import Session

from service.platform.db.base import Json
from service.platform.db.clock import now
from service.platform.db.jobs import Job, JobEvent

ATTEMPT = (Job.id, Job.kind, Job.attempt, Job.worker, Job.started_at)
"""What a row of the history takes from a job."""


_NOTE = insert(JobEvent).values(
    **{name: bindparam(name) for name in ("job_id", "kind", "attempt", "what", "worker", "started_at", "reason")},
    at=now(),
    tallied=False,
)


def note(session: Session, job: Any, what: str, problem: Json | None = None) -> None:
    """Note what became of a job's present attempt. ``job`` is its row, or the columns of ``ATTEMPT``.

    One statement. An attempt that has begun and not ended is in the job's own row, so a claim writes nothing here.
    """
    event = {
        "job_id": job.id,
        "kind": job.kind,
        "attempt": job.attempt,
        "what": what,
        "worker": job.worker,
        "started_at": job.started_at,
        "reason": problem["code"][:100] if problem and "code" in problem else None,
    }
    session.connection().execute(_NOTE, event)
