"""Marks a folder as the database's store, once, unless its content contradicts that.

A folder without its marker is an empty one (a first start), one from before there were markers, or the bare mount
point of a disk that is not there. The last looks like a store that lost everything, so it is refused.
"""

from __future__ import annotations

import asyncio
import logging

from sqlalchemy import func, select
from sqlalchemy.exc import SQLAlchemyError

from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.storage.store import MARKER, Store

# So many of the newest objects are looked for: one that is there tells that the folder is ours.
_LOOKED_FOR = 50
_AGAIN_S = 10.0

log = logging.getLogger(__name__)


class StrangeFolderError(Exception):
    """The store's folder holds nothing of what the database says is in it; ``hint`` says what to do."""

    def __init__(self, folder: str, objects: int) -> None:
        super().__init__(
            f"the folder {folder} is not this database's: it lacks the file {MARKER} and what was looked for of the "
            f"{objects} objects that the database names"
        )
        self.hint = (
            "Is its disk mounted, and its path right? If the objects are lost, restore a backup into a new database "
            "and a new folder; or go on without them: `python -m service.platform.storage.prepare --anew` with "
            "this service's settings (embedded: APEXCAL_DATA_DIR)."
        )


def adopt(database: Database, store: Store) -> None:
    """Mark the store's folder as this database's, unless it is. Nothing is done with a bucket.

    Raises :class:`StrangeFolderError`; SQLAlchemy's errors where the database does not say what it knows, and OSError
    where the folder cannot be looked into.
    """
    if store.is_prepared():
        return
    stored = select(Blob.key).where(Blob.state == "stored")
    with database.reading() as session:
        newest = session.scalars(stored.order_by(Blob.created_at.desc()).limit(_LOOKED_FOR)).all()
        if newest and not any(_is_there(store, key) for key in newest):
            count = session.scalar(select(func.count()).select_from(stored.subquery())) or 0
            raise StrangeFolderError(str(store.folder), count)
    store.prepare()


def _is_there(store: Store, key: str) -> bool:
    assert store.folder
    try:
        (store.folder / key).stat()
    except (FileNotFoundError, NotADirectoryError):
        return False  # any other error says nothing of whose folder it is
    return True


def adopt_if_known(database: Database, store: Store) -> None:
    """:func:`adopt`, where database and disk answer; else the folder stays without its marker, the store away."""
    try:
        adopt(database, store)
    except (SQLAlchemyError, OSError) as error:
        log.warning("the folder %s waits to be marked: %s", store.folder, type(error).__name__)


async def keep_adopting(database: Database, store: Store) -> None:
    """Try until the folder is marked, or another disk is in its place."""
    while not await asyncio.to_thread(store.is_prepared):
        await asyncio.sleep(_AGAIN_S)
        try:
            await asyncio.to_thread(adopt_if_known, database, store)
        except StrangeFolderError as error:
            log.error("%s. %s", error, error.hint)
