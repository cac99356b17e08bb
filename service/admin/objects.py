"""The store during a backup or restore: removals wait until all is copied, and failures are tried again."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from sqlalchemy import delete, select, update
from sqlalchemy.exc import SQLAlchemyError

from service.admin.context import AdminError
from service.platform.db.base import new_id
from service.platform.db.clock import now
from service.platform.db.recordings import BlobHold
from service.platform.db.session import Database
from service.platform.storage.errors import StoreUnavailableError

# A backup that was killed holds the store for this long and no longer.
HOLD_S = 120.0
_RENEW_S = 20.0
# Seconds between the tries of an operation, each of which has the store's own time limit.
PAUSES_S = (0.5, 2.0)

T = TypeVar("T")

log = logging.getLogger(__name__)


@contextmanager
def holding(database: Database, reason: str) -> Iterator[Callable[[], None]]:
    """Hold every object for the block; call what is yielded to be sure that the hold was never interrupted."""
    hold_id = new_id()
    with database.writing() as session:
        session.execute(delete(BlobHold).where(BlobHold.until < now()))
        session.add(BlobHold(id=hold_id, reason=reason, until=now(HOLD_S)))
    ended = threading.Event()

    def renew() -> None:
        while not ended.wait(_RENEW_S):
            try:
                with database.writing() as session:
                    # Only while the hold is in force: a lapsed one proves nothing about removals meanwhile.
                    mine = (BlobHold.id == hold_id) & (BlobHold.until > now())
                    session.execute(update(BlobHold).where(mine).values(until=now(HOLD_S)))
            except SQLAlchemyError as error:
                log.warning("could not renew the hold on the store (%s); trying again", type(error).__name__)

    def check() -> None:
        with database.reading() as session:
            hold = session.scalar(select(BlobHold.id).where(BlobHold.id == hold_id, BlobHold.until > now()))
        if hold is None:
            raise AdminError(
                "the hold on the store lapsed, so objects may have been removed before they were copied",
                "Was the database away for two minutes? Start the backup again.",
            )

    renewing = threading.Thread(target=renew, name="hold", daemon=True)
    renewing.start()
    try:
        yield check
    finally:
        ended.set()
        renewing.join()
        with database.writing() as session:
            session.execute(delete(BlobHold).where(BlobHold.id == hold_id))


def retried(attempt: Callable[[], T]) -> T:
    """Return what ``attempt`` returns. Raise :class:`StoreUnavailableError` if the last try fails too."""
    for pause in PAUSES_S:
        try:
            return attempt()
        except StoreUnavailableError:
            time.sleep(pause)
    return attempt()
