"""The migrations make what the models say, on both databases."""

import sqlite3
from contextlib import closing
from pathlib import Path
from uuid import uuid4

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import inspect, text

from service.db.migrate import NewerSchemaError, config, upgrade
from service.db.models import Base
from service.db.revisions import known, newest, stored
from service.db.session import Database


# SQLAlchemy cannot read an index of an expression from SQLite; PostgreSQL's is compared.
@pytest.mark.filterwarnings("ignore:Skipped unsupported reflection of expression-based index")
@pytest.mark.filterwarnings("ignore:autogenerate skipping metadata-specified expression-based index")
def test_migrated_schema_equals_the_models(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


def test_every_table_is_there_and_a_second_upgrade_changes_nothing(database_url: str) -> None:
    upgrade(database_url)
    opened = Database(database_url)
    assert set(inspect(opened.engine).get_table_names()) == {*Base.metadata.tables, "alembic_version"}
    # The service tells the newest revision by the files' names, so the chain must follow them.
    with opened.reading() as session:
        assert stored(session) == newest()
    opened.close()


def test_a_schema_of_a_newer_version_is_named_and_left(database_url: str) -> None:
    upgrade(database_url)
    _call_revision(database_url, "9999")
    try:
        with pytest.raises(NewerSchemaError, match=f"revision 9999 .* knows {known()[0]} as the newest"):
            upgrade(database_url)
    finally:
        _call_revision(database_url, known()[0])


def test_without_corners_no_other_corner_is_left_that_would_be_taken_for_a_tip(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/corners.db"
    upgrade(url)
    places = "sweep_index, x, y, z, corner) VALUES (?, ?, 3, 1.0, 2.0, 0.5, ?)"
    with closing(sqlite3.connect(tmp_path / "corners.db")) as apart, apart:  # which looks after no foreign key
        for corner in ("top", "left"):
            apart.execute(f"INSERT INTO apex (id, recording_id, {places}", (uuid4().hex, uuid4().hex, corner))
    opened = Database(url)
    with opened.engine.execution_options(apexcal_writes=True).begin() as connection:
        settings = config(url)
        settings.attributes["connection"] = connection
        command.downgrade(settings, "0015")
        assert connection.scalar(text("SELECT count(*) FROM apex")) == 1
    opened.close()


def _call_revision(database_url: str, version: str) -> None:
    opened = Database(database_url)
    with opened.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = :version"), {"version": version})
    opened.close()
