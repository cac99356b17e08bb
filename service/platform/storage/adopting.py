"""Marks a folder as the database's store at the first start.

Later a folder without its marker is the bare mount point of a disk that is not there, which looks like a store that
lost everything, or a copy that was made without the marker. So it is refused.
"""

from __future__ import annotations

import asyncio
import logging

from sqlalchemy import func, select
from sqlalchemy.exc import SQLAlchemyError

from service.platform.db.recordings import Blob
from service.platform.db.session import Database
from service.platform.storage.store import MARKER, Store

_AGAIN_S = 10.0

log = logging.getLogger(__name__)


class StrangeFolderError(Exception):
    """The store's folder has no marker, and the database names objects; ``hint`` says what to do."""

    def __init__(self, folder: str, objects: int) -> None:
        super().__init__(
            f"the folder {folder} is not this database's: it lacks the file {MARKER}, and the database names "
            f"{objects} objects"
        )
        self.hint = (
            "Is its disk mounted, and its path right? If the objects are lost, restore a backup into a new database "
            "and a new folder. To take the folder as it is: `python -m service.platform.storage.prepare --anew` with "
            "this service's settings (embedded: APEXCAL_DATA_DIR)."
        )


def adopt(database: Database, store: Store) -> None:
    """Mark the store's folder as this database's, unless it is. Nothing is done with a bucket.

    Raises :class:`StrangeFolderError`; SQLAlchemy's errors where the database does not say what it knows, and OSError
    where the folder cannot be written.
    """
    if store.is_prepared():
        return
    with database.reading() as session:
        count = session.scalar(select(func.count()).where(Blob.state == "stored"))
    if count:
        raise StrangeFolderError(str(store.folder), count)
    store.prepare()


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
