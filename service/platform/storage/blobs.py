"""Rows of blobs: a key is reserved before its first byte, and condemned if its object comes into no use.

So every object has a row, and the table, not a listing of the store, tells what a crash left.
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

# First and longest pause before an object is tried again that the store did not remove: it may be away for a moment.
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

    ``size`` and ``sha256`` are what its writer announces, if anything.
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
    """Return the keys of the files of a recording's sensors."""
    return list(session.scalars(select(Sensor.blob_key).where(Sensor.recording_id == recording_id)))


def give_up(session: Session, key: str) -> None:
    """Condemn a reservation whose object is in no use. If `keep` was committed after all, the object stays."""
    session.execute(update(Blob).where(Blob.key == key, Blob.state == "reserved").values(state="condemned"))


def condemn_lost(session: Session) -> None:
    """Condemn reservations of attempts that another one replaced, of jobs that are gone, and of abandoned uploads."""
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
    """Return keys whose objects are to be removed; none while a backup holds the store."""
    # One statement reads hold and list, so no list that was made before a hold has a key condemned after it.
    hold = exists().where(BlobHold.until > now())
    due = or_(Blob.remove_after.is_(None), Blob.remove_after < now())
    return list(session.scalars(select(Blob.key).where(Blob.state == "condemned", due, ~hold).limit(limit)))


def postpone(session: Session, keys: Iterable[str]) -> None:
    """Try later again to remove these objects, each time after twice the pause."""
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
