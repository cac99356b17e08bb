"""A job whose worker died, or whose database, store or disk failed: tried again, or failed with the reason.

A lease is lost if its value did not change for ``lease_s`` by this process's own clock. No wall clock takes part: one
that steps, here, at a worker or at the database, neither ends a lease nor prolongs it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from datetime import datetime

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.db.base import Json
from service.platform.db.clock import now
from service.platform.db.jobs import Job, JobEvent
from service.platform.jobs.history import note
from service.platform.jobs.kinds import kind_of
from service.platform.jobs.queue import end_jobs
from service.platform.settings import get_settings

# How much longer a job waits after each loss than after the one before, and the longest.
_LONGER = 4
LONGEST_S = 128.0


def record_loss(
    session: Session, job: Job, what: str, problem: Json, after_s: float = 0.0, *, tries: int | None = None
) -> None:
    """Count a loss of a running job, whose row the caller has locked, and queue it again; a cancelled job ends.

    ``what`` is ``lost`` if its worker was lost, perhaps by the job's own doing: ``max_lost_leases`` of these end it
    as failed with ``problem``. It is ``stumbled`` if its surroundings failed, such as a store: ``max_stumbles`` of
    these end it, after about an hour. Until then the job waits ``after_s`` seconds, longer each time, and then for
    its turn. ``tries``: number of losses with this problem's code that end it.
    """
    note(session, [job], what, problem)
    job.lost += 1
    job.lease_until = None
    alone = select(Job.id).where(Job.id == job.id)
    if job.cancel_requested:
        end(session, alone, WorkState.CANCELLED)
        return
    counted = select(func.count()).where(JobEvent.job_id == job.id, JobEvent.what == what)
    if tries is not None:
        counted = counted.where(JobEvent.reason == problem["code"])
    times = session.scalar(counted) or 0
    settings = get_settings()
    if times >= (tries or (settings.max_lost_leases if what == "lost" else settings.max_stumbles)):
        end(session, alone, WorkState.FAILED, problem)
    else:
        job.state = WorkState.QUEUED
        job.sends = 0
        longer = min(after_s * _LONGER ** min(times - 1, 10), LONGEST_S)
        job.send_after = session.scalar(select(now(longer)))


def end(session: Session, jobs: Select[int], state: WorkState, problem: Json | None = None) -> int:
    """End the jobs of a query, which no worker finishes, as their kinds say. Return how many."""
    ended = end_jobs(session, jobs, state, problem)
    for kind in sorted({job.kind for job in ended}):
        kind_of(kind).end(session, [job.subject_id for job in ended if job.kind == kind], state, problem)
    return len(ended)


LeaseValue = tuple[int, int, datetime | None]
"""A running job's id, attempt and ``lease_until``. Each renewal writes another ``lease_until``."""


class LeaseWatch:
    """Remembers since when each lease has its value, in seconds of watching."""

    def __init__(self) -> None:
        self._since: dict[LeaseValue, float] = {}
        self._watched_s = 0.0
        self._looked_at = time.monotonic()

    def lost(self, leases: Iterable[LeaseValue]) -> list[LeaseValue]:
        """Return those of the present leases that are lost. Whoever lost them is fenced out by the attempt."""
        settings = get_settings()
        moment = time.monotonic()
        # While this process was frozen, or saw no database, renewals went unseen: that time does not count.
        self._watched_s += min(moment - self._looked_at, 2 * settings.sweep_s)
        self._looked_at = moment
        self._since = {lease: self._since.get(lease, self._watched_s) for lease in leases}
        return [lease for lease, since in self._since.items() if self._watched_s - since >= settings.lease_s]
