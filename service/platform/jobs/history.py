"""What became of each attempt at a job: one row, written in the transaction in which it happens.

Totals of all kinds only grow, also when the rows that they counted are removed.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

from sqlalchemy import bindparam, insert, select, update
from sqlalchemy.orm import Session

from service.platform.db.base import Json
from service.platform.db.clock import now
from service.platform.db.jobs import Job, JobEvent, JobTotal
from service.platform.db.session import put

ATTEMPT = (Job.id, Job.kind, Job.attempt, Job.worker, Job.started_at)
"""What a row of the history takes from a job."""


_NOTE = insert(JobEvent).values(
    **{name: bindparam(name) for name in ("job_id", "kind", "attempt", "what", "worker", "started_at", "reason")},
    at=now(),
    tallied=False,
)


def note(session: Session, jobs: Sequence[Any], what: str, problem: Json | None = None) -> None:
    """Note what became of jobs' present attempts. ``jobs`` are their rows, or the columns of ``ATTEMPT``.

    One statement. An attempt that has begun and not ended is in the job's own row, so a claim writes nothing here.
    """
    reason = problem["code"][:100] if problem and "code" in problem else None
    events = [
        {"job_id": job.id, "kind": job.kind, "attempt": job.attempt, "worker": job.worker}
        | {"started_at": job.started_at, "what": what, "reason": reason}
        for job in jobs
    ]
    if events:
        session.connection().execute(_NOTE, events)


BUCKETS_S = (0.1, 0.5, 1.0, 5.0, 15.0, 60.0, 300.0, 1800.0)
"""Upper limits of the counted durations; one more bucket holds what took longer."""
_BATCH = 5000


def tally(session: Session) -> None:
    """Add what happened since the last time to the totals, each event once whoever else tallies beside."""
    fresh = select(JobEvent.id).where(~JobEvent.tallied).order_by(JobEvent.id).limit(_BATCH)
    rows = session.execute(
        update(JobEvent)
        .where(JobEvent.id.in_(fresh.with_for_update(skip_locked=True).cte("fresh").select()), ~JobEvent.tallied)
        .values(tallied=True)
        .returning(JobEvent.kind, JobEvent.what, JobEvent.started_at, JobEvent.at)
    ).all()
    durations: dict[tuple[str, str], list[float]] = defaultdict(list)
    for kind, what, started_at, at in rows:
        durations[kind, what].append(max(0.0, (at - started_at).total_seconds()) if started_at else 0.0)
    # In one order, so that two that tally at once wait for each other instead of locking each other out.
    for (kind, what), seconds in sorted(durations.items()):
        _add(session, kind, what, seconds)


def _add(session: Session, kind: str, what: str, seconds: Iterable[float]) -> None:
    put(session, JobTotal, {"kind": kind, "what": what})
    total = session.get_one(JobTotal, (kind, what), with_for_update=True)
    buckets: list[Any] = list(total.buckets) or [0] * (len(BUCKETS_S) + 1)
    for duration in seconds:
        buckets[bisect_left(BUCKETS_S, duration)] += 1
        total.count += 1
        total.seconds += duration
    total.buckets = buckets
    session.flush()
