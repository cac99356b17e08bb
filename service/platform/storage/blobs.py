"""Blobs by row: a key is reserved before its first byte and condemned when nobody won it.

So no object is ever without a row, and what a crash left is found by asking the table, never by listing the store.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from datetime import timedelta
from uuid import UUID

from sqlalchemy import and_, delete, exists, or_, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.platform.db.base import new_id
from service.platform.db.clock import now
from service.platform.db.jobs import Job
from service.platform.db.recordings import Blob, BlobHold, Sensor
from service.platform.storage.errors import ReservationEndedError

# When an object that could not be removed is tried again: as after a store that was away for a moment, at last daily.
_TRY_AGAIN, _LATEST = timedelta(seconds=10), timedelta(days=1)
# A reservation without a job is an upload part on its way; no part takes this long.
_ABANDONED_S = 2 * 3600.0

log = logging.getLogger(__name__)


def reserve(
    session: Session,
    prefix: str,
    *,
    suffix: str = "",
    job_id: int | None = None,
    attempt: int | None = None,
    size: int = 0,
    sha256: str | None = None,
) -> str:
    """Reserve a fresh key under ``prefix``. Commit before writing the object's first byte.

    ``size`` and ``sha256`` are what its writer announces, where that is known.
    """
    key = f"{prefix}/{new_id().hex}{suffix}"
    session.add(Blob(key=key, job_id=job_id, attempt=attempt, size=size, sha256=sha256))
    return key


def keep(session: Session, key: str, *, size: int, sha256: str | None = None) -> None:
    """Declare that the object is durable and in use, in the transaction of the row that uses it.

    Raises :class:`ReservationEndedError` unless the key is reserved: what was condemned may be removed at any moment.
    """
    reserved = update(Blob).where(Blob.key == key, Blob.state == "reserved")
    updated = session.execute(reserved.values(state="stored", size=size, sha256=sha256).returning(Blob.key))
    if updated.one_or_none() is None:
        raise ReservationEndedError(key)


def condemn(session: Session, keys: Iterable[str]) -> None:
    """Declare that nothing uses these objects any more; the reaper removes them."""
    session.execute(update(Blob).where(Blob.key.in_(list(keys))).values(state="condemned"))


def sensor_keys(session: Session, recording_id: UUID) -> list[str]:
    """The keys of a recording's sensors' files."""
    return list(session.scalars(select(Sensor.blob_key).where(Sensor.recording_id == recording_id)))


def give_up(session: Session, key: str) -> None:
    """Condemn a reservation that nobody won. One that was kept meanwhile stays: its commit may be unknown to us."""
    session.execute(update(Blob).where(Blob.key == key, Blob.state == "reserved").values(state="condemned"))


def condemn_lost(session: Session) -> None:
    """Condemn reservations whose work ended without winning: another attempt, or no job, or long abandoned."""
    working = select(Job.id).where(Job.id == Blob.job_id, Job.attempt == Blob.attempt, Job.state == WorkState.RUNNING)
    session.execute(
        update(Blob)
        .where(
            Blob.state == "reserved",
            or_(
                and_(Blob.job_id.is_not(None), ~working.exists()),
                and_(Blob.job_id.is_(None), Blob.created_at < now(-_ABANDONED_S)),
            ),
        )
        .values(state="condemned")
    )


def condemned(session: Session, limit: int = 200) -> list[str]:
    """Keys whose objects are to be removed; none while a backup holds the store."""
    # In one statement with the list: what is condemned after a backup's hold is never on a list made before it.
    hold = exists().where(BlobHold.until > now())
    due = or_(Blob.remove_after.is_(None), Blob.remove_after < now())
    return list(session.scalars(select(Blob.key).where(Blob.state == "condemned", due, ~hold).limit(limit)))


def postpone(session: Session, keys: Iterable[str]) -> None:
    """Look at these objects, which the store did not remove, again later: each time twice as late."""
    stubborn = select(Blob).where(Blob.key.in_(list(keys)), Blob.state == "condemned").order_by(Blob.key)
    for blob in session.scalars(stubborn.with_for_update()).all():
        if blob.failed_removals == 0:
            log.warning("object %s could not be removed; it is tried again, later each time", blob.key)
        later = min(_TRY_AGAIN * 2 ** min(blob.failed_removals, 20), _LATEST)
        blob.failed_removals += 1
        blob.remove_after = session.scalar(select(now(later.total_seconds())))


def forget(session: Session, keys: Iterable[str]) -> None:
    """Drop the rows of objects that have been removed."""
    session.execute(delete(Blob).where(Blob.key.in_(list(keys)), Blob.state == "condemned"))
