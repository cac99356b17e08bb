"""A worker's side of a job: claim it, keep the lease while working, and finish it exactly once."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import dataclass
from functools import partial
from typing import Any
from uuid import UUID

from sqlalchemy import bindparam, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.db.base import Json
from service.platform.db.clock import now, now_plus
from service.platform.db.jobs import Job
from service.platform.db.session import Database, repeated
from service.platform.jobs.history import ATTEMPT, note
from service.platform.jobs.kinds import kind_of, kinds
from service.platform.jobs.losses import record_loss
from service.platform.jobs.queue import release
from service.platform.settings import get_settings

log = logging.getLogger(__name__)

# Between renewals, so that a cancelled job ends within a second.
_LOOK_S = 0.5

# Built once: SQLAlchemy takes ten times longer to build such a statement than to run it.
_CLAIM = (
    update(Job)
    .where(Job.id == bindparam("job"), Job.state == WorkState.QUEUED, ~Job.cancel_requested)
    # A message may be older than a stumble: a job in backoff is not claimed until it is sent again.
    .where((Job.attempt == 0) | (Job.sends > 0))
    .where(Job.kind.in_(bindparam("kinds", expanding=True)))
    .values(
        state=WorkState.RUNNING,
        attempt=Job.attempt + 1,
        worker=bindparam("by"),
        started_at=now(),
        progress=None,
        lease_until=now_plus("lease_s"),
    )
    .returning(
        *(Job.id, Job.attempt, Job.kind, Job.queue), *(Job.fleet_id, Job.subject_id, Job.payload, Job.request_id)
    )
)
_MINE = (Job.id == bindparam("job")) & (Job.attempt == bindparam("mine")) & (Job.state == WorkState.RUNNING)
_RENEW = (
    update(Job)
    .where(_MINE)
    .values(lease_until=now_plus("lease_s"), progress=bindparam("so_far"))
    .returning(Job.cancel_requested)
)
_LOOK = select(Job.cancel_requested).where(_MINE)
_END = (
    update(Job)
    .where(_MINE)
    .values(state=bindparam("ended_as"), problem=bindparam("because"), finished_at=now(), lease_until=None)
    .returning(*ATTEMPT, Job.cancel_requested)
)
_GIVE_BACK = (
    update(Job).where(_MINE).values(state=WorkState.QUEUED, lease_until=None, send_after=now()).returning(*ATTEMPT)
)


class LostLeaseError(Exception):
    """Somebody else holds the job now; whatever was computed is dropped."""


class StaleInputError(Exception):
    """What the work was computed from has changed: it is computed again."""


class CancelledError(Exception):
    """The job's owner asked for its end."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A job as this worker holds it. ``attempt`` is the fencing token."""

    job_id: int
    attempt: int
    kind: str
    queue: str
    fleet_id: UUID
    subject_id: UUID
    payload: Json
    request_id: str | None


def claim(database: Database, job_id: int, worker: str) -> Claim | None:
    """Take a job that was sent for one lease, or None: a twin message, a cancelled job, one in backoff, one done.

    While versions overlap there are jobs that only the newer workers know; an older one leaves them in the queue, and
    the reaper sends them again until one who knows them looks.
    """
    names = [kind.name for kind in kinds()]
    bindings = {"job": job_id, "by": worker, "kinds": names, "lease_s": get_settings().lease_s}
    with database.alone() as connection:
        row = connection.execute(_CLAIM, bindings).one_or_none()
    return Claim(*row) if row else None


class Lease:
    """Renews a claim from a thread of its own and writes progress with it, until the block ends.

    Works beside a computing main thread because the kernels release the interpreter lock. They look at ``flag`` (0
    while the work is wanted), everything else calls :meth:`check`.
    """

    def __init__(self, database: Database, claim: Claim) -> None:
        self._database = database
        self._held = claim
        self._progress: Json | None = None
        self._ended = threading.Event()
        self._broken: type[BaseException] | None = None
        self.flag = bytearray(1)
        # In a copy of this context, so that what the thread logs carries the request's id.
        renewing = partial(copy_context().run, self._renew)
        self._thread = threading.Thread(target=renewing, name=f"lease-{claim.job_id}", daemon=True)

    def __enter__(self) -> Lease:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()

    def report(self, fraction: float, message: str, seconds_left: float | None = None) -> None:
        """Note progress, written with the next renewal. Raises where the lease is lost or the job cancelled.

        ``seconds_left`` where the work knows it better than its share of the time passed tells.
        """
        self._progress = {"fraction": round(min(max(fraction, 0.0), 1.0), 4), "message": message}
        if seconds_left is not None:
            self._progress["seconds_left"] = round(max(seconds_left, 0.0), 1)
        self.check()

    def check(self) -> None:
        """Raise :class:`LostLeaseError`, :class:`CancelledError` or what :meth:`stop` was told."""
        if self._broken:
            raise self._broken

    def stop(self, why: type[BaseException]) -> None:
        """End the work: whatever computes looks within a second, and raises ``why``. From any thread."""
        self._broken = why
        self.flag[0] = 1

    def _renew(self) -> None:
        settings = get_settings()
        due = time.monotonic() + settings.renew_s
        while not self._ended.wait(min(_LOOK_S, settings.renew_s)):
            renewing = time.monotonic() >= due
            if renewing:
                due = time.monotonic() + settings.renew_s
            try:
                cancelled = self._ask(renewing, settings.lease_s)
            except Exception:
                if renewing:
                    log.exception("could not renew the lease of job %d; trying again", self._held.job_id)
                continue
            if cancelled is None:
                self.stop(LostLeaseError)
                return
            if cancelled:
                self.stop(CancelledError)

    def _ask(self, renewing: bool, lease_s: float) -> bool | None:
        """Whether the job is to be cancelled; None where it is another's. A look between renewals writes nothing."""
        mine = _mine(self._held)
        with self._database.alone() as connection:
            if not renewing:
                return connection.execute(_LOOK, mine).scalar_one_or_none()
            renewed = mine | {"lease_s": lease_s, "so_far": self._progress}
            return connection.execute(_RENEW, renewed).scalar_one_or_none()


@contextmanager
def finishing(
    database: Database, claim: Claim, state: WorkState = WorkState.DONE, problem: Json | None = None
) -> Iterator[Session]:
    """The one transaction that ends a job: the gate, the block's results, what the end means to
    the subject, the next release.

    Raises, with everything rolled back, :class:`LostLeaseError` where the job is no longer this worker's, and
    :class:`CancelledError` where it would be done although its end was asked for: nothing may follow it.
    """
    with database.writing() as session:
        ended = _mine(claim) | {"ended_as": state, "because": problem}
        passed = session.connection().execute(_END, ended).one_or_none()
        if passed is None:
            raise LostLeaseError(f"job {claim.job_id} is no longer attempt {claim.attempt}'s")
        if passed.cancel_requested and state == WorkState.DONE:
            raise CancelledError
        yield session
        note(session, [passed], state, problem)
        kind_of(claim.kind).end(session, [claim.subject_id], state, problem)
        # A capped queue locks the fleet, which is the last row of all.
        session.flush()
        release(session, claim.fleet_id, claim.queue)


def finish(
    database: Database,
    claim: Claim,
    write: Callable[[Session], object] | None = None,
    state: WorkState = WorkState.DONE,
    problem: Json | None = None,
) -> None:
    """End a job with what ``write`` puts into its last transaction; see :func:`finishing`.

    What it returns is handed over to the kind's ``take``. A deadlock repeats the transaction and not the work, so
    ``write`` may be called several times.
    """

    def once() -> None:
        with finishing(database, claim, state, problem) as session:
            handed_over = write(session) if write else None
            take = kind_of(claim.kind).take
            if take and handed_over is not None:
                take(session, claim.subject_id, handed_over)

    repeated(once)


def give_back(database: Database, claim: Claim) -> None:
    """Put a draining worker's job back into the queue, without counting it as a loss."""

    def once() -> None:
        with database.writing() as session:
            note(session, session.connection().execute(_GIVE_BACK, _mine(claim)).all(), "given_back")

    repeated(once)


def requeue_after_failure(
    database: Database,
    claim: Claim,
    problem: Json,
    after_s: float,
    *,
    suspect: bool = False,
    tries: int | None = None,
) -> None:
    """Put a job whose surroundings failed back into its queue, for ``after_s`` seconds and longer each time.

    A store or disk may be away for an hour. ``suspect``: the job itself may be the cause, so it counts as lost.
    ``tries``: number of failures with this problem after which the job fails.
    """

    def once() -> None:
        with database.writing() as session:
            job = session.scalars(select(Job).where(_MINE).with_for_update(), _mine(claim)).one_or_none()
            if job:
                record_loss(session, job, "lost" if suspect else "stumbled", problem, after_s, tries=tries)
                session.flush()
                release(session, claim.fleet_id, claim.queue)

    repeated(once)


def require_mine(session: Session, claim: Claim) -> None:
    """Hold the job's row until the commit. Raises :class:`LostLeaseError` where it is another's by now."""
    if session.execute(select(Job.id).where(_MINE).with_for_update(), _mine(claim)).one_or_none() is None:
        raise LostLeaseError(f"job {claim.job_id} is no longer attempt {claim.attempt}'s")


def _mine(claim: Claim) -> dict[str, Any]:
    return {"job": claim.job_id, "mine": claim.attempt}
