"""Compare the store with the table of blobs once a day: objects without a row, and rows without their object.

The reaper removes objects by their rows and lists nothing. The audit finds the rest: objects put at a presigned
address after its reservation ended, objects that a restored database lacks, and rows whose objects somebody removed.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

from sqlalchemy import exists, select, update

from service.platform.db.clock import now
from service.platform.db.jobs import Heartbeat
from service.platform.db.recordings import Blob, BlobHold
from service.platform.db.session import Database, put
from service.platform.settings import Settings
from service.platform.storage.store import ListedObject, Store

log = logging.getLogger(__name__)

AUDIT = "audit"
_PAGE = 500
_SHOWN = 10
# If more than this share of the objects lacks rows, the store is another service's, or the database is a backup's.
_LITTER = 0.1
_LITTER_AT_LEAST = 20


@dataclass
class Audit:
    """The result of an audit. ``orphans`` have no row; ``lost`` are keys of stored blobs that the store lacks."""

    objects: int = 0
    orphans: list[ListedObject] = field(default_factory=list)
    removed: int = 0
    lost: list[str] = field(default_factory=list)

    @property
    def orphan_bytes(self) -> int:
        """Return the bytes of all orphans."""
        return sum(orphan.size for orphan in self.orphans)


def audit_if_due(database: Database, store: Store, settings: Settings) -> Audit | None:
    """Audit if the settings ask for it and the last audit is ``audit_hours`` old; one of several callers does so."""
    if settings.audit == "off" or not _take_turn(database, settings.audit_hours * 3600):
        return None
    return audit(database, store, timedelta(hours=settings.orphan_hours), remove=settings.audit == "remove")


def audit(database: Database, store: Store, orphan_age: timedelta, *, remove: bool) -> Audit:
    """List the store, log orphans and lost objects, and ``remove`` orphans that are older than ``orphan_age``.

    It removes nothing while a backup holds the store, or if there are too many orphans.
    """
    with database.reading() as session:
        began = session.scalars(select(now())).one()
    report = Audit()
    listed: set[str] = set()
    for page in _pages(store.list()):
        report.objects += len(page)
        listed.update(listed_object.key for listed_object in page)
        report.orphans += _without_row(database, page, began - orphan_age)
    report.lost = list(_lost(database, listed, began))
    if report.lost:
        log.error("%d objects are gone from the store, among them %s", len(report.lost), report.lost[:_SHOWN])
    if not report.orphans:
        log.info("the audit of the store found %d objects, each with its row", report.objects)
        return report
    keys = [orphan.key for orphan in report.orphans]
    too_many = len(keys) > max(_LITTER_AT_LEAST, _LITTER * report.objects)
    if remove and not too_many and not _held(database):
        removed, failed = store.delete_all(keys)
        report.removed = len(removed)
        if failed:
            log.warning("the audit could not remove %d objects, among them %s", len(failed), failed[:_SHOWN])
    log.warning(
        "the audit of the store found %d objects; %d of %d bytes have no row, %d of them were removed%s; they are %s",
        report.objects,
        len(keys),
        report.orphan_bytes,
        report.removed,
        ": so many look like another service's, or like a database from a backup" if too_many else "",
        keys[:_SHOWN],
    )
    return report


def _take_turn(database: Database, period_s: float) -> bool:
    """Return whether no other caller took a turn within ``period_s``."""
    with database.writing() as session:
        # The first turn ever finds a row that is as old as can be.
        put(session, Heartbeat, {"name": AUDIT}, first={"at": datetime.fromtimestamp(0, UTC)})
        late = update(Heartbeat).where(Heartbeat.name == AUDIT, Heartbeat.at < now(-period_s)).values(at=now())
        taken = session.execute(late.returning(Heartbeat.name))
        return taken.one_or_none() is not None


def _pages(objects: Iterable[ListedObject]) -> Iterator[list[ListedObject]]:
    page: list[ListedObject] = []
    for listed in objects:
        page.append(listed)
        if len(page) == _PAGE:
            yield page
            page = []
    if page:
        yield page


def _without_row(database: Database, page: list[ListedObject], before: datetime) -> list[ListedObject]:
    """Return the objects of a page that are older than ``before`` and have no row."""
    # An interrupted write leaves a file with its object's name, a # and a number in the folder.
    old = {listed.key: listed.key.partition("#")[0] for listed in page if listed.modified < before}
    with database.reading() as session:
        keys = set(session.scalars(select(Blob.key).where(Blob.key.in_(set(old.values())))))
    return [listed for listed in page if listed.key in old and old[listed.key] not in keys]


def _lost(database: Database, listed: set[str], began: datetime) -> Iterator[str]:
    """Yield keys of blobs that were stored before the listing began, are still stored, and were not listed."""
    with database.engine.connect() as connection:
        stored = select(Blob.key).where(Blob.state == "stored", Blob.created_at < began)
        for key in connection.scalars(stored.execution_options(yield_per=_PAGE)):
            if key not in listed:
                yield key


def _held(database: Database) -> bool:
    with database.reading() as session:
        return bool(session.scalar(select(exists().where(BlobHold.until > now()))))
