"""Migrations that run while an older version serves: it goes on reading and writing, before, meanwhile and after."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import uuid4

import pytest
from alembic.script import ScriptDirectory
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError, OperationalError

from service.db.migrate import config, upgrade
from service.db.revisions import is_older, known, newest
from service.db.session import Database
from tests.support.postgres import Postgres
from tests.support.processes import wait_until

# What the first version writes and reads: every column that it had and must set, and no other.
_FLEET = "INSERT INTO fleet (id, name, version, created_at) VALUES (:id, :name, 1, 0)"
_JOB = (
    "INSERT INTO job (fleet_id, kind, queue, subject_id, payload, state, attempt, lost, sends, cancel_requested,"
    " created_at) VALUES (:fleet, 'solve', 'solve', :fleet, '{}', 'queued', 0, 0, 0, :no, 0)"
)
_CLAIM = "UPDATE job SET state = 'running', attempt = attempt + 1 WHERE state = 'queued' AND fleet_id = :fleet"
_FINISH = "UPDATE job SET state = 'done', finished_at = 1 WHERE state = 'running' AND fleet_id = :fleet"
_BLOB = "INSERT INTO blob (key, state, size, created_at) VALUES (:key, 'stored', 1, 0)"
_READ = (
    "SELECT id, fleet_id, kind, queue, subject_id, payload, state, attempt, lost, sends, send_after, lease_until,"
    " cancel_requested, worker, progress, problem, created_at, started_at, finished_at"
    " FROM job WHERE fleet_id = :fleet"
)


@pytest.fixture(params=["sqlite", "postgresql"])
def first_version(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """A database as the first version left it."""
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path / 'old.db'}"
    else:
        server: Postgres = request.getfixturevalue("postgres")
        url = server.create(f"old_{uuid4().hex}")
    upgrade(url, "0001")
    yield url


# On SQLite a writer is never behind a reader.
ON_POSTGRESQL = pytest.mark.parametrize("first_version", ["postgresql"], indirect=True)


class OlderApi:
    """Writes and reads as the first version did."""

    def __init__(self, url: str) -> None:
        self.database = Database(url)
        self.done = 0

    def once(self) -> None:
        """A fleet, a blob, a job through all its states, and everything read again."""
        fleet = uuid4().hex
        given = {"id": fleet, "name": f"fleet {fleet}", "key": f"key {fleet}", "fleet": fleet, "no": False}
        with self.database.writing() as session:
            for statement in (_FLEET, _BLOB, _JOB):
                session.execute(text(statement), given)
        for statement in (_CLAIM, _FINISH):
            with self.database.writing() as session:
                session.execute(text(statement), given)
        with self.database.reading() as session:
            (row,) = session.execute(text(_READ), given).all()
        assert (row.state, row.attempt) == ("done", 1)
        self.done += 1

    def close(self) -> None:
        self.database.close()


def test_an_older_version_works_while_newer_migrations_run_and_after(first_version: str) -> None:
    older = OlderApi(first_version)
    older.once()
    failures: list[BaseException] = []
    enough = threading.Event()

    def serve() -> None:
        while not enough.is_set():
            try:
                older.once()
            except (DBAPIError, AssertionError) as error:
                failures.append(error)

    serving = threading.Thread(target=serve)
    serving.start()
    before = older.done
    try:
        upgrade(first_version)
        wait_until(lambda: older.done > before or bool(failures), "a round of the older version")
    finally:
        enough.set()
        serving.join()
    assert failures == []
    assert older.done > before
    older.once()
    with older.database.reading() as session:
        assert session.scalar(text("SELECT version_num FROM alembic_version")) == newest()
        assert session.scalar(text("SELECT count(*) FROM fleet")) == older.done
    older.close()


def test_two_at_once_wait_for_each_other(first_version: str) -> None:
    with ThreadPoolExecutor(3) as pool:
        for done in [pool.submit(upgrade, first_version) for _ in range(3)]:
            done.result()


@ON_POSTGRESQL
def test_a_long_transaction_holds_up_the_migration_and_nobody_else(first_version: str) -> None:
    """The report that somebody started before lunch: others come through while the migration waits its turn."""
    database = Database(first_version)
    reader = database.engine.connect()
    reader.execute(text("SELECT count(*) FROM job"))
    older = OlderApi(first_version)
    with ThreadPoolExecutor(1) as pool:
        migrating = pool.submit(upgrade, first_version)
        # Behind a statement that waits for a table this would last until the reader's end, which is below.
        end = time.monotonic() + 4
        while time.monotonic() < end:
            older.once()
        assert not migrating.done()
        reader.rollback()
        reader.close()
        migrating.result(30)
    older.close()
    database.close()


@ON_POSTGRESQL
def test_it_gives_up_in_words_where_a_lock_is_never_free(first_version: str) -> None:
    database = Database(first_version)
    with database.engine.connect() as holder:
        holder.execute(text("LOCK TABLE job IN ACCESS SHARE MODE"))
        with pytest.raises(OperationalError, match="lock timeout"):
            upgrade(first_version, patience_s=0.0)
    upgrade(first_version)
    database.close()


@ON_POSTGRESQL
def test_an_index_that_a_broken_migration_left_unfinished_is_made_anew(first_version: str) -> None:
    upgrade(first_version, "0005")
    database = Database(first_version)
    with database.writing() as session:
        session.execute(text("CREATE INDEX ix_job_running ON job (id)"))
        left = "UPDATE pg_index SET indisvalid = false WHERE indexrelid = 'ix_job_running'::regclass"
        session.execute(text(left))
    upgrade(first_version)
    with database.reading() as session:
        made = "SELECT indisvalid AND indpred IS NOT NULL FROM pg_index WHERE indexrelid = 'ix_job_running'::regclass"
        assert session.scalar(text(made))
    database.close()


def test_which_schema_is_older() -> None:
    assert known()[-1] == "0001" and is_older("0001")
    assert not is_older(newest()) and not is_older("of another age")


def test_the_names_of_the_files_are_the_revisions() -> None:
    assert known() == tuple(script.revision for script in ScriptDirectory.from_config(config("")).walk_revisions())
