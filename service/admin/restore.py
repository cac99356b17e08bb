"""Restores a backup into an empty database and store of either kind."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from sqlalchemy import Connection, func, inspect, select, text
from sqlalchemy.engine import make_url

from service.admin.backup import TRANSIENT
from service.admin.errors import AdminError
from service.admin.manifest import BlobFile, Manifest, table_path, verify
from service.admin.retries import retried
from service.admin.rows import read_table
from service.platform.db.migrate import upgrade
from service.platform.db.models import Base
from service.platform.db.revisions import known
from service.platform.db.session import Database
from service.platform.storage.store import Store

Report = Callable[[str], None]


def restore(url: str, store: Store, folder: Path, *, report: Report = lambda _: None) -> Manifest:
    """Bring the database at ``url`` and the store to what they were.

    Every file is checked first. The objects come before the rows, and the rows in one transaction, so that a restore
    that fails leaves an empty database and can be started again. Raises :class:`AdminError`.
    """
    manifest, blobs = verify(folder)
    report(f"checked {len(manifest.tables)} tables and {len(blobs)} objects of {manifest.made_at}")
    if manifest.schema not in known():
        raise AdminError(
            f"the backup's schema {manifest.schema} is newer than this version's {known()[0]}",
            "Restore it with the version that made it, or a newer one.",
        )
    _refuse_unless_empty(store, blobs)
    upgrade(url, manifest.schema if _is_fresh(url) else "head")
    database = Database(url, patient=True)
    try:
        _refuse_rows(database)
        store.prepare()
        for blob in blobs:
            retried(partial(store.put_file, blob.key, blob.path(folder)))
        report(f"{len(blobs)} objects, {manifest.blob_bytes} bytes")
        with database.engine.execution_options(apexcal_writes=True).begin() as connection:
            _load(connection, manifest, folder, report)
    finally:
        database.close()
    upgrade(url)
    return manifest


def _load(connection: Connection, manifest: Manifest, folder: Path, report: Report) -> None:
    for table in manifest.tables:
        has = {column["name"] for column in inspect(connection).get_columns(table.name)}
        lacks = [name for name, _ in table.columns if name not in has]
        if lacks:
            raise AdminError(
                f"the table {table.name} has no column {lacks[0]!r} any more",
                "Restore into a database without tables: it gets the backup's own schema and is migrated after.",
            )
        count = read_table(connection, table, table_path(folder, table.name))
        if count != table.rows:
            raise AdminError(f"{table.name} has {count} rows and should have {table.rows}", "Use another backup.")
        _continue_numbers(connection, table.name)
        report(f"{table.name}: {count} rows")


def _continue_numbers(connection: Connection, name: str) -> None:
    """Let PostgreSQL number on after the rows that were brought; SQLite does so by itself."""
    table = Base.metadata.tables.get(name)
    numbered = table.autoincrement_column if table is not None else None
    if table is None or numbered is None or connection.dialect.name != "postgresql":
        return
    highest = connection.scalar(select(func.max(numbered)))
    if highest is not None:
        connection.execute(
            text("SELECT setval(pg_get_serial_sequence(:table, :column), :highest)"),
            {"table": name, "column": numbered.name, "highest": highest},
        )


def _is_fresh(url: str) -> bool:
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite" and parsed.database and not Path(parsed.database).exists():
        return True
    database = Database(url, patient=True)
    try:
        return not inspect(database.engine).has_table("alembic_version")
    finally:
        database.close()


def _refuse_rows(database: Database) -> None:
    present = set(inspect(database.engine).get_table_names())
    with database.engine.connect() as connection:
        for table in Base.metadata.sorted_tables:
            if table.name in TRANSIENT or table.name not in present:
                continue
            if connection.scalar(select(func.count()).select_from(table)):
                raise AdminError(
                    f"the database is not empty: {table.name} has rows",
                    "A restore never mixes two histories. Give it a new database (or another --data folder).",
                )


def _refuse_unless_empty(store: Store, blobs: list[BlobFile]) -> None:
    known = {blob.key for blob in blobs}
    for found in store.list_unprepared():
        # What an earlier try at this restore brought is no other history.
        if found.key.partition("#")[0] not in known:
            raise AdminError(
                f"the store is not empty: it holds {found.key!r}",
                "Give the restore a new folder or bucket (APEXCAL_BLOB_URL, or another --data folder).",
            )
