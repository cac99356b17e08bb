"""Totals of what became of jobs. They only grow, also when the rows that they counted are removed."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.platform.db.jobs import JobEvent, JobTotal
from service.platform.db.upserts import put

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
        .execution_options(synchronize_session=False)
    ).all()
    found: dict[tuple[str, str], list[float]] = defaultdict(list)
    for kind, what, started_at, at in rows:
        found[kind, what].append(max(0.0, (at - started_at).total_seconds()) if started_at else 0.0)
    # In one order, so that two that tally at once wait for each other instead of locking each other out.
    for (kind, what), seconds in sorted(found.items()):
        _add(session, kind, what, seconds)


def _add(session: Session, kind: str, what: str, seconds: Iterable[float]) -> None:
    put(session, JobTotal, {"kind": kind, "what": what})
    total = session.get_one(JobTotal, (kind, what), with_for_update=True)
    buckets: list[Any] = list(total.buckets) or [0] * (len(BUCKETS_S) + 1)
    for one in seconds:
        buckets[bisect_left(BUCKETS_S, one)] += 1
        total.count += 1
        total.seconds += one
    total.buckets = buckets
    session.flush()
