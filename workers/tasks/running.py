"""One job from claim to end: the part that is the same for every kind of work."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from service.db.base import Json
from service.jobs.claims import CancelledError, Claim, Lease, LostLeaseError, claim, finishing, give_back, stumble
from service.observability.logs import about
from service.observability.request_ids import working_for
from service.storage.errors import MissingBlobError, ReservationEndedError
from workers.geometry.errors import InputError
from workers.readers.recording import ReadError
from workers.tasks.comparing import consistency
from workers.tasks.context import Context
from workers.tasks.detecting import detect
from workers.tasks.drain import DrainedError, interruptible, is_draining
from workers.tasks.ingesting import ingest
from workers.tasks.solving import solve
from workers.tasks.studying import clock_offset, preview, suggestion

log = logging.getLogger(__name__)

Work = Callable[[Context, Claim, Lease], Callable[[Session], None]]
"""Does a job's work outside any transaction and returns what writes its results inside the finishing one."""

WORK: dict[str, Work] = {
    "ingest": ingest,
    "preview": preview,
    "suggestion": suggestion,
    "detect": detect,
    "clock_offset": clock_offset,
    "solve": solve,
    "consistency": consistency,
}

# A stumble of the surroundings, not of the work: worth another try a little later.
_PASSING = (OperationalError, ConnectionError, TimeoutError, OSError, ReservationEndedError)
# The same where a process that read an upload says it; the file may have a part in that it was killed.
_PASSING_CODES = ("ingest_disk_full", "ingest_killed")
_SUSPECT_CODES = ("ingest_killed",)
_TRY_AGAIN_S = 2.0


def run_job(context: Context, job_id: int) -> None:
    """Claim a job, do it under its lease, and end it as done, failed or cancelled; or give it back."""
    held = None if is_draining() else claim(context.database, job_id, context.worker, WORK)
    if held is None:
        return
    with working_for(held.request_id), about(job=held.job_id, kind=held.kind, attempt=held.attempt):
        log.info("job %d begins", held.job_id)
        began = time.monotonic()
        _do(context, held)
        log.info("job %d: attempt %d took %.2f s", held.job_id, held.attempt, time.monotonic() - began)


def _do(context: Context, held: Claim) -> None:
    try:
        with Lease(context.database, held) as lease, interruptible(lease):
            write = WORK[held.kind](context, held, lease)
            lease.check()
            with finishing(context.database, held) as session:
                write(session)
    except LostLeaseError:
        log.warning("job %d attempt %d lost its lease; its work is dropped", held.job_id, held.attempt)
    except CancelledError:
        log.info("job %d was cancelled", held.job_id)
        _end(context, held, "cancelled", None)
    except (ReadError, InputError, MissingBlobError) as error:
        # Notes are for the operator: what a reading process said before it died.
        said = "\n".join([error.code, *getattr(error, "__notes__", [])])
        if error.code in _PASSING_CODES:
            log.warning("job %d stumbled; it is tried again: %s", held.job_id, said)
            suspect = error.code in _SUSPECT_CODES
            stumble(context.database, held, _refusal(error), _TRY_AGAIN_S, suspect=suspect)
        else:
            log.info("job %d refused its input: %s", held.job_id, said)
            _end(context, held, "failed", _refusal(error))
    except _PASSING as error:
        log.exception("job %d stumbled; it is tried again", held.job_id)
        stumble(context.database, held, _surroundings(error), _TRY_AGAIN_S)
    except DrainedError:
        log.info("job %d is given back: this worker was asked to stop", held.job_id)
        # Over a fresh connection: one that was interrupted within a statement can be used for nothing more.
        context.database.close()
        give_back(context.database, held)
    except Exception:
        log.exception("job %d failed", held.job_id)
        _end(context, held, "failed", _INTERNAL)


_INTERNAL: Json = {
    "code": "internal_error",
    "detail": "The work ended with an error that apexcal did not expect.",
    "hint": "This is a defect of the service, not of your data. The worker's log has the details; tell the operator.",
}


def _refusal(error: ReadError | InputError | MissingBlobError) -> Json:
    """A refusal as a problem; what a program can answer with, such as `candidates`, stands beside the sentences."""
    more = error.fields if isinstance(error, ReadError) else {}
    return {**more, "code": error.code, "detail": error.message, "hint": error.hint}


def _surroundings(error: Exception) -> Json:
    """What to say when it never passes. An OSError's own text may hold a path of the worker, so its reason alone."""
    reason = (error.strerror if isinstance(error, OSError) else None) or type(error).__name__
    return {
        "code": "surroundings_failed",
        "detail": f"The work was tried several times, and what the worker needs failed each time: {reason}.",
        "hint": "Nothing is wrong with your data. The operator should look at the worker's disk, database and store; "
        "ask for it again after that.",
    }


def _end(context: Context, held: Claim, state: str, problem: Json | None) -> None:
    try:
        with finishing(context.database, held, state, problem):
            pass
    except LostLeaseError:
        log.warning("job %d attempt %d lost its lease before it could end as %s", held.job_id, held.attempt, state)
