"""One job from claim to end: the part that is the same for every kind of work."""

from __future__ import annotations

import errno
import logging
import time
from collections.abc import Callable, Collection
from importlib import import_module

from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.orm import Session

from apexcal.documents.errors import DocumentError
from apexcal.documents.states import WorkState
from service.platform.db.base import Json
from service.platform.jobs.claims import (
    CancelledError,
    Claim,
    Lease,
    LostLeaseError,
    StaleInputError,
    claim,
    finish,
    give_back,
    requeue_after_failure,
)
from service.platform.jobs.kinds import kinds
from service.platform.jobs.messages import Message
from service.platform.observability.logs import about
from service.platform.observability.request_ids import working_for
from service.platform.storage.errors import MissingBlobError, ReservationEndedError
from workers.readers.recording import ReadError
from workers.tasks.context import Context
from workers.tasks.drain import DrainedError, interruptible, is_draining

log = logging.getLogger(__name__)

Work = Callable[[Context, Claim, Lease], Callable[[Session], object]]
"""Does a job's work outside any transaction and returns what writes its results inside the finishing one.

What that returns is handed over to the resource (`service.platform.handovers`)."""


def _of(module: str, kind: str) -> Work:
    """The function of this name. Its module is loaded by need: solver and detectors are half a worker's memory."""

    def do(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], object]:
        work: Work = getattr(import_module(f"workers.tasks.{module}"), kind)
        return work(context, claim, lease)

    return do


_MODULES = {
    "ingest": "ingesting",
    "calibrated_copy": "copying",
    "preview": "analysing",
    "suggestion": "analysing",
    "detect": "detecting",
    "clock_offset": "analysing",
    "machine_marks": "marking",
    "precision": "solving",
    "solve": "solving",
    "conclude": "concluding",
    "report": "reporting",
    "remedies": "remedies",
    "pixel_points": "locating",
    "pair_validation": "validating",
    "lane_validation": "validating",
    "edge_validation": "validating",
}
WORK: dict[str, Work] = {kind: _of(module, kind) for kind, module in _MODULES.items()}
# The modules that need no kernels.
_READING = {"ingesting", "copying"}

# A stumble of the surroundings, not of the work: worth another try a little later.
_PASSING = (OperationalError, ConnectionError, TimeoutError, OSError, ReservationEndedError)
# Among these, what only the input can cause: a name or file that is too long, a row too large (SQLSTATE 54).
_NEVER_PASSING = (errno.ENAMETOOLONG, errno.EFBIG, errno.E2BIG)
_PROGRAM_LIMIT = "54"
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
# The process that read an upload was killed: the surroundings may be why, or the file.
_SUSPECT_CODES = ("ingest_killed",)
_TRY_AGAIN_S = 2.0
# Tries where there was no room, with waits of 2, 8 and 32 s: what another failing job leaves is swept within seconds.
# A disk that is full for longer needs an operator, and each try would fill it for everybody again.
_TRIES_WITHOUT_ROOM = 4


def prepare(queues: Collection[str]) -> None:
    """Load what jobs of these queues need, and compile kernels: before the pool is forked, so that it shares them."""
    modules = {_MODULES[kind.name] for kind in kinds() if kind.queue in queues}
    for module in sorted(modules):
        import_module(f"workers.tasks.{module}")
    if modules - _READING:
        import_module("workers.tasks.warming").warm_up()


def run_job(context: Context, job_id: int, kind: str = "") -> str | None:
    """Claim a job, do it under its lease, and end it as done, failed or cancelled; or give it back.

    Returns the code of the problem if the job ended as failed. If the database cannot be asked, the message of this
    ``kind`` goes back to its queue, for a worker that can.
    """
    try:
        current = None if is_draining() else claim(context.database, job_id, context.worker)
    except (OperationalError, PoolTimeoutError) as error:
        log.warning("job %d could not be claimed; its message goes back: %s", job_id, type(error).__name__)
        time.sleep(_TRY_AGAIN_S)
        context.send([Message(job_id, kind)] if kind else [])
        return None
    if current is None:
        return None
    with working_for(current.request_id), about(job=current.job_id, kind=current.kind, attempt=current.attempt):
        log.info("job %d begins", current.job_id)
        began, failure = time.monotonic(), None
        try:
            failure = _do(context, current)
        except OperationalError as error:
            # Its lease is not renewed any more, so the sweep gives the job to another attempt.
            log.warning(
                "job %d: its end could not be written: %s", current.job_id, str(error.orig).partition("\n")[0]
            )
        log.info("job %d: attempt %d took %.2f s", current.job_id, current.attempt, time.monotonic() - began)
    return failure


def _is_finished(context: Context, claim: Claim, lease: Lease) -> bool:
    """Do the work and write its end; False if what it was computed from changed before that."""
    write = WORK[claim.kind](context, claim, lease)
    lease.check()
    try:
        finish(context.database, claim, write)
    except StaleInputError:
        return False
    return True


def _do(context: Context, claim: Claim) -> str | None:
    """Do a claimed job and write its end. Returns the problem's code if that is a failure."""
    try:
        with Lease(context.database, claim) as lease, interruptible(lease):
            while not _is_finished(context, claim, lease):
                log.info("job %d: its input has changed meanwhile; it is done again", claim.job_id)
    except LostLeaseError:
        log.warning("job %d attempt %d lost its lease; its work is dropped", claim.job_id, claim.attempt)
    except CancelledError:
        log.info("job %d was cancelled", claim.job_id)
        _end(context, claim, WorkState.CANCELLED, None)
    except (ReadError, DocumentError, MissingBlobError) as error:
        # Notes are for the operator: what a reading process said before it died.
        return _refused(context, claim, error, "\n".join([error.code, *getattr(error, "__notes__", [])]))
    except _PASSING as error:
        return _stumbled(context, claim, error)
    except DrainedError:
        log.info("job %d is given back: this worker was asked to stop", claim.job_id)
        # Over a fresh connection: one that was interrupted within a statement can be used for nothing more.
        context.database.close()
        give_back(context.database, claim)
    except Exception as error:
        refused = getattr(error, "orig", None)  # by a column, within a statement
        if isinstance(refused, DocumentError):
            return _refused(context, claim, refused, refused.code)
        log.exception("job %d failed", claim.job_id)
        return _end(context, claim, WorkState.FAILED, _INTERNAL)
    return None


def _refused(
    context: Context, claim: Claim, error: ReadError | DocumentError | MissingBlobError, reason: str
) -> str | None:
    """The input cannot be used; or the process that read it was killed or had no room, and it is tried again."""
    if error.code in _SUSPECT_CODES:
        log.warning("job %d stumbled; it is tried again: %s", claim.job_id, reason)
        requeue_after_failure(context.database, claim, _refusal(error), _TRY_AGAIN_S, suspect=True)
    elif error.code == _DISK_FULL["code"]:
        log.warning("job %d had no room: %s", claim.job_id, reason)
        requeue_after_failure(context.database, claim, _DISK_FULL, _TRY_AGAIN_S, tries=_TRIES_WITHOUT_ROOM)
    else:
        log.info("job %d refused its input: %s", claim.job_id, reason)
        return _end(context, claim, WorkState.FAILED, _refusal(error))
    return None


def _stumbled(context: Context, claim: Claim, error: Exception) -> str | None:
    """Let the job stumble: database, store or disk failed, and a later try may succeed."""
    number = error.errno if isinstance(error, OSError) else None
    state = getattr(getattr(error, "orig", None), "sqlstate", None) or ""
    if number in _NEVER_PASSING or state.startswith(_PROGRAM_LIMIT):
        log.exception("job %d failed, and would fail again", claim.job_id)
        return _end(context, claim, WorkState.FAILED, _INTERNAL)
    if number in _NO_ROOM:
        log.exception("job %d had no room", claim.job_id)
        requeue_after_failure(context.database, claim, _DISK_FULL, _TRY_AGAIN_S, tries=_TRIES_WITHOUT_ROOM)
    else:
        log.exception("job %d stumbled; it is tried again", claim.job_id)
        requeue_after_failure(context.database, claim, _surroundings(error), _TRY_AGAIN_S)
    return None


_DISK_FULL: Json = {
    "code": "ingest_disk_full",
    "detail": f"The service had no room for the files of this work, {_TRIES_WITHOUT_ROOM} times within a minute.",
    "hint": "Nothing is wrong with your data, and it is kept. Ask whoever runs the service for space on the worker's "
    "disk and in the store, or delete recordings that nobody needs; then ask for the work again.",
}

_INTERNAL: Json = {
    "code": "internal_error",
    "detail": "The work ended with an error that apexcal did not expect.",
    "hint": "This is a defect of the service, not of your data. The worker's log has the details; tell the operator.",
}


def _refusal(error: ReadError | DocumentError | MissingBlobError) -> Json:
    """A refusal as a problem; what a program can answer with, such as `candidates`, stands beside the sentences."""
    more = error.fields if isinstance(error, ReadError) else {}
    return {**more, "code": error.code, "detail": error.message, "hint": error.hint}


def _surroundings(error: Exception) -> Json:
    """Return the problem if it never passes. It names an OSError by its reason alone: the text may hold a path."""
    reason = (error.strerror if isinstance(error, OSError) else None) or type(error).__name__
    return {
        "code": "surroundings_failed",
        "detail": f"The work was tried several times, and what the worker needs failed each time: {reason}.",
        "hint": "Nothing is wrong with your data. The operator should look at the worker's disk, database and store; "
        "ask for it again after that.",
    }


def _end(context: Context, claim: Claim, state: WorkState, problem: Json | None) -> str | None:
    try:
        finish(context.database, claim, state=state, problem=problem)
        return problem["code"] if problem else None
    except LostLeaseError:
        log.warning("job %d attempt %d lost its lease before it could end as %s", claim.job_id, claim.attempt, state)
    return None
