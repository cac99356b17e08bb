"""The roles that migrations make: each with its own rights on each table, and no others."""

import re
from collections.abc import Iterator
from uuid import uuid4

import psycopg
import pytest
from psycopg import sql
from sqlalchemy.engine import make_url

from service.platform.db.grants import API, INGEST, OF_API, OF_INGEST, WORKERS
from service.platform.db.migrate import make_roles, upgrade
from service.platform.db.models import Base
from tests.support.postgres import OF_WORKERS, Postgres

ROLES = {OF_WORKERS: WORKERS, OF_API: API, OF_INGEST: INGEST}
# A statement for each verb that touches no row. A right is asked for before a column's constraint.
TABLE = {
    "SELECT": "SELECT * FROM {table} WHERE false",
    "INSERT": "INSERT INTO {table} DEFAULT VALUES",
    "DELETE": "DELETE FROM {table} WHERE false",
    "TRUNCATE": "TRUNCATE {table} CASCADE",
}
COLUMN = {
    "SELECT": "SELECT {column} FROM {table} WHERE false",
    "UPDATE": "UPDATE {table} SET {column} = DEFAULT WHERE false",
}
CREDENTIALS = ("api_token", "browser_session", "sign_in_link", "idempotency_key", "membership")


@pytest.fixture(scope="module")
def url(postgres: Postgres) -> str:
    """A database whose roles had rights on everything, as earlier versions gave them."""
    url = postgres.create(f"roles_{uuid4().hex}")
    upgrade(url)
    with psycopg.connect(make_url(url).set(drivername="postgresql").render_as_string()) as session:
        for _ in range(2):
            make_roles(url, dict.fromkeys(ROLES, "it's 100% secret"))
            session.execute(f"GRANT ALL ON ALL TABLES IN SCHEMA public TO {', '.join(ROLES)}".encode())
            session.commit()
    make_roles(url, dict.fromkeys(ROLES, "it's 100% secret"))
    return url


@pytest.fixture(params=ROLES)
def role(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def session(url: str, role: str) -> Iterator[psycopg.Connection]:
    """A connection of the role."""
    address = make_url(url).set(drivername="postgresql", username=role).render_as_string()
    with psycopg.connect(address) as connection:
        yield connection
        connection.rollback()


def allows(session: psycopg.Connection, statement: str, **names: str) -> bool:
    """Whether the role may do this, which is taken back at once."""
    composed = sql.SQL(statement).format(**{name: sql.Identifier(value) for name, value in names.items()})
    try:
        session.execute(composed)
    except psycopg.errors.InsufficientPrivilege:
        return False
    except psycopg.Error as error:
        assert error.sqlstate and error.sqlstate.startswith("23"), error  # a constraint
    finally:
        session.rollback()
    return True


def granted(rights: str, verb: str, column: str | None = None) -> bool:
    """What the table of grants says of a verb: on the whole table, or on a column of it."""
    columns = dict(re.findall(r"(\w+) \(([^)]*)\)", rights))
    whole = re.findall(r"\w+", re.sub(r"\w+ \([^)]*\)", "", rights))
    named = [name.strip(' "') for name in columns.get(verb, "").split(",")]
    return verb in whole or (column is not None and column in named)


def test_each_verb_on_each_table_and_column_is_allowed_where_the_grants_say_so(session, role):
    grants, wrong = ROLES[role], []
    tables = {name: [column.name for column in table.columns] for name, table in Base.metadata.tables.items()}
    for table, columns in (tables | {"alembic_version": ["version_num"]}).items():
        rights = grants.get(table, "")
        wrong += [
            (table, verb)
            for verb, statement in TABLE.items()
            if allows(session, statement, table=table) != granted(rights, verb)
        ]
        wrong += [
            (table, column, verb)
            for column in columns
            for verb, statement in COLUMN.items()
            if allows(session, statement, table=table, column=column) != granted(rights, verb, column)
        ]
    assert not wrong and set(grants) <= {*tables, "alembic_version"}


def test_nobody_makes_owners_of_others_or_changes_what_was_published(session, role):
    for statement in (
        "UPDATE person SET is_owner = true",
        "UPDATE publication SET result_id = NULL",
        "DELETE FROM publication",
        "UPDATE result SET document = NULL",
        "UPDATE alembic_version SET version_num = '0'",
        "DELETE FROM alembic_version",
        "DROP TABLE job",
        "CREATE TABLE other (id int)",
        "CREATE ROLE other",
        "COPY job TO PROGRAM 'true'",
        "SELECT setval('job_id_seq', 1)",
    ):
        assert not allows(session, statement), statement
    assert allows(session, "SELECT nextval('job_id_seq')")


@pytest.mark.parametrize("role", [OF_WORKERS, OF_INGEST])
def test_a_worker_has_nothing_to_do_with_people_and_credentials(url, role):
    address = make_url(url).set(drivername="postgresql", username=role).render_as_string()
    with psycopg.connect(address) as session:
        for table in CREDENTIALS:
            assert not any(allows(session, statement, table=table) for statement in TABLE.values()), table
        for statement in (
            "INSERT INTO person (name, is_owner) VALUES ('x', true)",
            "UPDATE person SET name = 'x'",
            "SELECT is_owner FROM person",
            "SELECT path FROM audit_entry",
            "DELETE FROM audit_entry",
            "UPDATE recording SET fleet_id = NULL",
            "UPDATE correspondence_set SET pairs = NULL",
            "UPDATE answer SET u = 0",
            "DELETE FROM recording",
        ):
            assert not allows(session, statement), statement


def test_who_decodes_uploads_makes_no_result_and_reads_no_marks(url):
    """Nor does it publish, or take room from a fleet: it writes what becomes of an upload."""
    address = make_url(url).set(drivername="postgresql", username=OF_INGEST).render_as_string()
    with psycopg.connect(address) as session:
        for table in ("apex", "vertex", "answer", "correspondence_set", "calibration_run", "slot", "person"):
            assert not any(allows(session, statement, table=table) for statement in TABLE.values()), table
        for statement in (
            "INSERT INTO publication DEFAULT VALUES",
            "INSERT INTO result DEFAULT VALUES",
            "UPDATE result SET verdict = 'pass'",
            "SELECT document FROM result",
            "UPDATE calibration SET state = 'done'",
            "UPDATE fleet SET row_bytes = 0",
            "DELETE FROM blob",
        ):
            assert not allows(session, statement), statement
