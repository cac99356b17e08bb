"""The reaper: every two seconds it recovers jobs that were lost, never sent or cancelled, and removes leftovers.

Nothing else recovers work. Two reapers at once do no harm: each row is decided by one UPDATE that checks its state.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from uuid import UUID

from sqlalchemy import ColumnElement, bindparam, exists, or_, select, tuple_, update
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.db.base import Json, state_literal
from service.platform.db.clock import now
from service.platform.db.fleets import Fleet
from service.platform.db.jobs import Heartbeat, Job
from service.platform.db.rounds import is_away, one_by_one
from service.platform.db.session import Database, post, put
from service.platform.jobs.history import tally
from service.platform.jobs.losses import LONGEST_S, LeaseWatch, end, record_loss
from service.platform.jobs.messages import COURIER, Message
from service.platform.jobs.queue import release
from service.platform.jobs.queues import QUEUES
from service.platform.jobs.retention import forget_workers
from service.platform.settings import get_settings
from service.platform.storage.blobs import condemn_lost, condemned, forget, postpone
from service.platform.storage.store import Store

log = logging.getLogger(__name__)
_BATCH = 200
# A message is sent again after `resend_s` times this at most.
_MOST_RESENDS = 2**5
LEASES = LeaseWatch()


def reap(database: Database, store: Store, gets_on: Callable[[], None] = lambda: None) -> None:
    """Make one pass over everything that may need recovery. A step that fails does not stop the others.

    ``gets_on`` is called before each step. Raises the first failure once all have been tried; at once where the
    database is away, as none of them can work.
    """
    steps: tuple[Callable[[], None], ...] = (
        partial(_write, database, _beat),
        partial(_recover_lost, database),
        partial(_end_cancelled, database),
        partial(_write, database, _send_again),
        partial(_write, database, _end_backoff),
        partial(_release_waiting, database),
        partial(_write, database, tally),
        partial(_write, database, forget_workers),
        partial(_remove_blobs, database, store),
    )
    failures: list[Exception] = []
    for step in steps:
        gets_on()
        try:
            step()
        except Exception as error:
            if is_away(error):
                raise
            log.exception("a step of the reaper failed")
            failures.append(error)
    if failures:
        raise failures[0]


def _write(database: Database, step: Callable[[Session], None]) -> None:
    with database.writing() as session:
        step(session)


def _beat(session: Session) -> None:
    """Write the reaper's heartbeat."""
    put(session, Heartbeat, {"name": "sweep"}, {"at": now()})


def _recover_lost(database: Database) -> None:
    """Give the jobs of workers that died or stalled to others."""
    running = Job.state == state_literal(WorkState.RUNNING)
    with database.reading() as session:
        rows = session.execute(select(Job.id, Job.attempt, Job.lease_until).where(running)).all()
    lost = LEASES.lost((job_id, attempt, until) for job_id, attempt, until in rows)
    if lost:
        # With its value: one that was renewed meanwhile is not lost.
        _each(database, running & tuple_(Job.id, Job.attempt, Job.lease_until).in_(lost), _recover)


def _each(database: Database, which: ColumnElement[bool], decide: Callable[[Session, Job], object]) -> None:
    """Decide every matching job, oldest first, in a transaction of its own: its row locked and looked at again.

    Stops when the next pass is due twice over, so that thousands of jobs do not delay the other steps.
    """
    end = time.monotonic() + 2 * get_settings().sweep_s
    last = 0
    while time.monotonic() < end:
        with database.reading() as session:
            oldest = select(Job.id).where(which, Job.id > last).order_by(Job.id)
            ids = session.scalars(oldest.limit(_BATCH)).all()
        if not ids:
            return
        last = ids[-1]
        for job_id in ids:
            if time.monotonic() >= end:
                return
            _decide(database, job_id, which, decide)


def _decide(
    database: Database, job_id: int, which: ColumnElement[bool], decide: Callable[[Session, Job], object]
) -> None:
    try:
        with database.writing() as session:
            again = select(Job).where(Job.id == job_id, which).with_for_update(skip_locked=True)
            job = session.scalars(again).one_or_none()
            if job:
                decide(session, job)
    except Exception:
        # One job that cannot be decided must not keep the reaper from all the others.
        log.exception("the reaper could not decide job %d", job_id)


def _recover(session: Session, job: Job) -> None:
    """A lease was not renewed."""
    log.warning("job %d lost attempt %d on %s", job.id, job.attempt, job.worker)
    record_loss(session, job, "lost", _worker_lost(job))


def _worker_lost(job: Job) -> Json:
    return {
        "code": "worker_lost",
        "detail": f"The work was started {job.attempt} times, and {get_settings().max_lost_leases} times its worker "
        "died or stalled.",
        "hint": "The input may need more memory or time than a worker has; the operator's log of the worker "
        f"{job.worker} tells more. Ask for it again after that.",
    }


def _end_cancelled(database: Database) -> None:
    """End the queued jobs whose end was asked for: many at a time, or one by one where these do not end together."""
    which = (Job.state == state_literal(WorkState.QUEUED)) & Job.cancel_requested
    some = select(Job.id).where(which).order_by(Job.id).limit(_BATCH).with_for_update(skip_locked=True)
    until, count = time.monotonic() + 2 * get_settings().sweep_s, _BATCH
    try:
        while count == _BATCH and time.monotonic() < until:
            with database.writing() as session:
                count = end(session, some, WorkState.CANCELLED)
    except Exception as error:
        if is_away(error):
            raise
        log.exception("the reaper could not end cancelled jobs together")
        alone = select(Job.id).where(which)
        _each(database, which, lambda session, job: end(session, alone.where(Job.id == job.id), WorkState.CANCELLED))


def _due(longest_s: float) -> ColumnElement[bool]:
    """Whether a job's time has come, or lies farther ahead than any wait: then the database's clock stepped back."""
    return or_(Job.send_after < now(), Job.send_after > now(longest_s))


def _send_again(session: Session) -> None:
    """Send what was sent and is still unclaimed; twice as late each time."""
    settings = get_settings()
    overdue = (
        select(Job.id, Job.kind, Job.sends)
        .where(Job.state == state_literal(WorkState.QUEUED), Job.sends > 0, ~Job.cancel_requested)
        .where(_due(settings.resend_s * _MOST_RESENDS))
        .order_by(Job.id)
        .limit(_BATCH)
        .with_for_update(skip_locked=True)
    )
    for job_id, kind, sends in session.execute(overdue).all():
        later = now(settings.resend_s * min(2**sends, _MOST_RESENDS))
        session.execute(update(Job).where(Job.id == job_id).values(sends=sends + 1, send_after=later))
        post(session, COURIER, Message(job_id, kind))


def resent_after_s(sends: int) -> float:
    """Seconds from a job's first message to when one more follows the last of ``sends``."""
    return get_settings().resend_s * sum(min(2**sent, _MOST_RESENDS) for sent in range(sends))


def _end_backoff(session: Session) -> None:
    """Let the jobs whose time to be tried again has come wait for their place in the window, as fresh ones do."""
    over = (
        select(Job.id)
        .where(Job.state == state_literal(WorkState.QUEUED), Job.sends == 0, _due(LONGEST_S))
        .order_by(Job.id)
        .limit(_BATCH)
        .with_for_update(skip_locked=True)
        .cte("over")
    )
    session.execute(update(Job).where(Job.id.in_(select(over.c.id))).values(send_after=None))


def _release_waiting(database: Database) -> None:
    """Top up every fleet's window, in case that the finish that should have done it never came."""
    # One look for each fleet, however many jobs wait.
    waits = exists().where(
        Job.fleet_id == Fleet.id,
        Job.queue == bindparam("queue"),
        Job.state == state_literal(WorkState.QUEUED),
        Job.send_after.is_(None),
    )
    fleets = select(Fleet.id).where(waits)
    with database.reading() as session:
        windows = [(id, queue) for queue in QUEUES for id in session.scalars(fleets, {"queue": queue}).all()]
    one_by_one("the window of", windows, partial(_top_up, database))


def _top_up(database: Database, window: tuple[UUID, str]) -> None:
    with database.writing() as session:
        release(session, *window)


def _remove_blobs(database: Database, store: Store) -> None:
    """Remove the objects that no row uses, then their rows; a crash in between only repeats the removal.

    An object that the store does not remove keeps no other from it.
    """
    with database.writing() as session:
        condemn_lost(session)
        keys = condemned(session)
    removed, postponed = store.delete_all(keys, time.monotonic() + 2 * get_settings().sweep_s)
    if removed or postponed:
        with database.writing() as session:
            forget(session, removed)
            postpone(session, postponed)
