"""The store against the table: what has no row goes after a while, what has no object is told."""

import os
import time
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import update

from service.platform.db.base import new_id
from service.platform.db.clock import now, utc_now
from service.platform.db.jobs import Heartbeat
from service.platform.db.recordings import Blob, BlobHold
from service.platform.db.session import Database
from service.platform.settings import Settings
from service.platform.storage.audit import audit, audit_if_due
from service.platform.storage.store import Store
from tests.support.folders import folder_store

NO_AGE = timedelta(seconds=-60)


@pytest.fixture
def store(settings: Settings, request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    """A folder beside SQLite, a bucket beside PostgreSQL."""
    if settings.database.startswith("sqlite"):
        return folder_store(tmp_path / "blobs")
    return request.getfixturevalue("s3_server").store()


def fill(database: Database, store: Store, rows: dict[str, str], objects: list[str]) -> None:
    with database.writing() as session:
        session.add_all(Blob(key=key, state=state) for key, state in rows.items())
    for key in objects:
        store.put_bytes(key, b"12345")


def keys(store: Store) -> set[str]:
    return {one.key for one in store.list()}


def test_orphans_go_and_lost_objects_are_told(database: Database, store: Store, caplog) -> None:
    rows = {"a/stored": "stored", "a/reserved": "reserved", "a/condemned": "condemned", "a/lost": "stored"}
    fill(database, store, rows, ["a/stored", "a/reserved", "a/condemned", "a/orphan", "probe/1"])
    found = audit(database, store, NO_AGE, remove=True)
    assert (found.objects, found.removed, found.orphan_bytes) == (5, 2, 10)
    assert found.lost == ["a/lost"] and "a/lost" in caplog.text and "a/orphan" in caplog.text
    assert keys(store) == {"a/stored", "a/reserved", "a/condemned"}
    again = audit(database, store, NO_AGE, remove=True)
    assert again.orphans == []


def test_an_orphan_that_cannot_be_removed_keeps_no_other_from_it(database: Database, tmp_path: Path, caplog) -> None:
    store = folder_store(tmp_path / "folder")
    fill(database, store, {}, [f"a/{number}" for number in range(5)])
    # What an interrupted write seems to have left, and is a folder: no store removes it.
    (store.folder / "a" / "9#1").mkdir()
    found = audit(database, store, NO_AGE, remove=True)
    assert found.removed == 5 and "could not remove 1 objects" in caplog.text
    assert keys(store) == {"a/9#1"}


def test_young_objects_held_ones_and_reports_stay(database: Database, store: Store) -> None:
    fill(database, store, {}, ["a/orphan"])
    assert audit(database, store, timedelta(hours=1), remove=True).orphans == []
    assert len(audit(database, store, NO_AGE, remove=False).orphans) == 1
    with database.writing() as session:
        session.add(BlobHold(id=new_id(), reason="backup", until=utc_now() + timedelta(hours=1)))
    assert audit(database, store, NO_AGE, remove=True).removed == 0
    assert keys(store) == {"a/orphan"}


def test_the_store_of_another_database_is_not_emptied(database: Database, store: Store, caplog) -> None:
    fill(database, store, {}, [f"a/{number}" for number in range(25)])
    found = audit(database, store, NO_AGE, remove=True)
    assert (len(found.orphans), found.removed) == (25, 0) and "another service" in caplog.text
    assert len(keys(store)) == 25


def test_what_interrupted_writes_left_in_a_folder_goes_too(database: Database, tmp_path: Path) -> None:
    store = folder_store(tmp_path / "folder")
    fill(database, store, {"a/known": "reserved"}, [])
    (tmp_path / "folder/a").mkdir(parents=True)
    for name in ("known#1", "unknown#1"):
        (tmp_path / "folder/a" / name).write_bytes(b"half")
        os.utime(tmp_path / "folder/a" / name, times=(time.time() - 100,) * 2)
    assert audit(database, store, timedelta(seconds=50), remove=True).removed == 1
    assert keys(store) == {"a/known#1"}


def test_of_all_services_one_audits_and_once_a_day(database: Database, store: Store, settings: Settings) -> None:
    assert audit_if_due(database, store, settings) is not None
    assert audit_if_due(database, store, settings) is None
    with database.writing() as session:
        session.execute(update(Heartbeat).values(at=now(-25 * 3600)))
    assert audit_if_due(database, store, settings.model_copy(update={"audit": "off"})) is None
    assert audit_if_due(database, store, settings) is not None
