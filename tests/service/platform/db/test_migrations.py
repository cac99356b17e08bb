"""The migrations make what the models say, on both databases."""

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import uuid4

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, text

from service.platform.db import revisions
from service.platform.db.migrate import NewerSchemaError, OtherSchemaError, config, upgrade
from service.platform.db.models import Base
from service.platform.db.revisions import all_revisions, is_older, newest, stored
from service.platform.db.session import Database, open_engine
from tests.support.postgres import Postgres

# All that PostgreSQL says of columns, constraints and indexes.
_POSTGRESQL = (
    "SELECT table_name || '.' || column_name, data_type || character_maximum_length || is_nullable || column_default"
    " FROM (SELECT table_name, column_name, data_type, is_nullable, coalesce(column_default, '') AS column_default,"
    " coalesce(character_maximum_length, 0) AS character_maximum_length"
    " FROM information_schema.columns WHERE table_schema = 'public') AS c",
    "SELECT conrelid::regclass || '.' || conname, pg_get_constraintdef(oid)"
    " FROM pg_constraint WHERE connamespace = 'public'::regnamespace",
    "SELECT indexname, indexdef FROM pg_indexes WHERE schemaname = 'public'",
)


def _written(engine: Engine) -> dict[str, object]:
    """The schema in the database's own words, without Alembic's table; lines of a table in any order."""
    with engine.connect() as connection:
        if engine.dialect.name == "postgresql":
            rows = [row for query in _POSTGRESQL for row in connection.execute(text(query))]
        else:
            rows = connection.execute(text("SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL")).all()
    lines = {name: sorted(re.sub(r",?\s*$", "", line) for line in sql.splitlines()) for name, sql in rows}
    return {name: line for name, line in lines.items() if "alembic_version" not in name}


@pytest.fixture(params=["sqlite", "postgresql"])
def make_url(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Addresses of databases without a table."""

    def make() -> str:
        name = f"empty_{uuid4().hex}"
        if request.param == "sqlite":
            return f"sqlite:///{tmp_path / name}.db"
        server: Postgres = request.getfixturevalue("postgres")
        return server.create(name)

    return make


def test_the_migrated_schema_is_what_the_models_make(make_url: Callable[[], str]) -> None:
    url = make_url()
    upgrade(url)
    migrated = open_engine(url)
    modelled = open_engine(make_url())
    with modelled.execution_options(apexcal_writes=True).begin() as connection:
        Base.metadata.create_all(connection)
    says = _written(modelled)
    assert len(says) > len(Base.metadata.tables)
    assert _written(migrated) == says
    modelled.dispose()
    migrated.dispose()


# SQLAlchemy cannot read an index of an expression from SQLite; PostgreSQL's is compared.
@pytest.mark.filterwarnings("ignore:Skipped unsupported reflection of expression-based index")
@pytest.mark.filterwarnings("ignore:autogenerate skipping metadata-specified expression-based index")
def test_nothing_is_left_for_the_next_revision(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


def test_a_second_upgrade_changes_nothing(make_url: Callable[[], str]) -> None:
    url = make_url()
    upgrade(url)
    upgrade(url)
    opened = Database(url)
    # The service tells the newest revision by the files' names, so the chain must follow them.
    with opened.reading() as session:
        assert stored(session) == newest()
    opened.close()


def test_several_at_once_wait_for_each_other(make_url: Callable[[], str]) -> None:
    url = make_url()
    with ThreadPoolExecutor(3) as pool:
        for done in [pool.submit(upgrade, url) for _ in range(3)]:
            done.result()


def test_a_schema_of_a_newer_version_is_named_and_left(make_url: Callable[[], str]) -> None:
    url = make_url()
    upgrade(url)
    opened = Database(url)
    with opened.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(NewerSchemaError, match=f"revision 9999 .* knows {all_revisions()[0]} as the newest"):
        upgrade(url)
    opened.close()


def test_a_database_of_a_development_version_is_refused_in_words_and_left(make_url: Callable[[], str]) -> None:
    url = make_url()
    upgrade(url)
    opened = Database(url)
    with opened.engine.begin() as connection:
        connection.execute(text("ALTER TABLE recording ADD COLUMN earlier INTEGER"))
    with pytest.raises(OtherSchemaError, match=r"table recording differs in earlier.* upload recordings again"):
        upgrade(url)
    with opened.engine.begin() as connection:
        connection.execute(text("ALTER TABLE recording DROP COLUMN earlier"))
    upgrade(url)
    opened.close()


def test_which_schema_is_older(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_older(newest()) and not is_older("of another age")
    monkeypatch.setattr(revisions, "all_revisions", lambda: ("0002", "0001"))
    assert is_older("0001") and not is_older("0002")


def test_the_names_of_the_files_are_the_revisions() -> None:
    assert all_revisions() == tuple(
        script.revision for script in ScriptDirectory.from_config(config()).walk_revisions()
    )
