"""Restores a backup into an empty database and store of either kind."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from sqlalchemy import inspect, select, text

from service.admin.context import AdminError
from service.admin.manifest import KEPT, ROWS, BlobFile, Manifest, copy_rows, url_of, verify
from service.admin.objects import retried
from service.platform.db.effects import entry_of_process
from service.platform.db.migrate import OtherSchemaError, upgrade
from service.platform.db.revisions import all_revisions, newest
from service.platform.db.session import Database
from service.platform.storage.store import Store

_OWNS_ALL = "SELECT bool_and(pg_has_role(tableowner, 'USAGE')) FROM pg_tables WHERE schemaname = 'public'"
Report = Callable[[str], None]


def restore(url: str, store: Store, folder: Path, *, report: Report = lambda _: None) -> Manifest:
    """Bring the database at ``url`` and the store to what they were.

    Every file is checked first. Rows of an older schema are migrated in a copy of their file. The objects come before
    the rows, and the rows in one transaction, so that a restore that fails leaves an empty database and can be
    started again. Raises :class:`AdminError`.
    """
    manifest, blobs = verify(folder)
    report(f"checked {sum(manifest.rows.values())} rows and {len(blobs)} objects of {manifest.made_at}")
    if manifest.schema_revision not in all_revisions():
        raise AdminError(
            f"the backup's schema {manifest.schema_revision} is newer than this version's {newest()}",
            "Restore it with the version that made it, or a newer one.",
        )
    _refuse_unless_empty(store, blobs)
    upgrade(url)
    database = Database(url, patient=True)
    try:
        _refuse_other_role(database)
        _refuse_rows(database)
        store.prepare()
        for blob in blobs:
            retried(partial(store.put_file, blob.key, blob.path(folder)))
        report(f"{len(blobs)} objects, {manifest.blob_bytes} bytes")
        _bring(database, folder / ROWS, report)
        with database.writing() as session:
            entry = entry_of_process(f"restore {folder}"[:500])
            entry.effect = f"All cars are answered as on {manifest.made_at}."
            session.add(entry)
    finally:
        database.close()
    return manifest


def _bring(database: Database, file: Path, report: Report) -> None:
    with TemporaryDirectory() as scratch:
        copy = Path(shutil.copy(file, scratch))
        try:
            upgrade(url_of(copy))
        except OtherSchemaError as error:
            raise AdminError(str(error), "Restore it with the version that made it.") from None
        rows = Database(url_of(copy))
        try:
            with (
                rows.engine.connect() as source,
                database.engine.execution_options(apexcal_writes=True).begin() as target,
            ):
                for name, count in copy_rows(source, target).items():
                    report(f"{name}: {count} rows")
        finally:
            rows.close()


def _refuse_other_role(database: Database) -> None:
    """Refuse any role but the migrations': a restore writes all tables, and no other role may."""
    with database.reading() as session:
        if database.engine.dialect.name == "postgresql" and not session.scalar(text(_OWNS_ALL)):
            raise AdminError(
                f"the database's role {database.engine.url.username} may not write all that a backup holds",
                "Restore with APEXCAL_DATABASE_URL of the role that migrations have.",
            )


def _refuse_rows(database: Database) -> None:
    present = set(inspect(database.engine).get_table_names())
    with database.reading() as session:
        for table in KEPT:
            if table.name in present and session.scalar(select(select(table).exists())):
                raise AdminError(
                    f"the database is not empty: {table.name} has rows",
                    "A restore never mixes two histories. Give it a new database (or another --data folder).",
                )


def _refuse_unless_empty(store: Store, blobs: list[BlobFile]) -> None:
    keys = {blob.key for blob in blobs}
    for listed in store.list_unprepared():
        # What an earlier try at this restore brought is no other history.
        if listed.key.partition("#")[0] not in keys:
            raise AdminError(
                f"the store is not empty: it holds {listed.key!r}",
                "Give the restore a new folder or bucket (APEXCAL_BLOB_URL, or another --data folder).",
            )
