"""The roles that migrations make: work on the tables, no more."""

from uuid import uuid4

from sqlalchemy import text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ProgrammingError

from service.platform.db.migrate import make_roles, upgrade
from service.platform.db.session import open_engine
from tests.support.postgres import Postgres


def test_a_workers_role_reads_no_credentials_and_changes_no_table(postgres: Postgres) -> None:
    url = postgres.create(f"roles_{uuid4().hex}")
    upgrade(url)
    names = {"apexcal_worker": "it's 100% secret", "apexcal_api": "b"}
    for _ in range(2):
        make_roles(url, names)

    def refused(role: str, statement: str) -> bool:
        engine = open_engine(str(make_url(url).set(username=role).render_as_string(hide_password=False)))
        try:
            with engine.begin() as connection:
                connection.execute(text(statement))
        except ProgrammingError as error:
            assert getattr(error.orig, "sqlstate", None) == "42501", error
            return True
        finally:
            engine.dispose()
        return False

    for role in names:
        assert not refused(role, "SELECT count(*) FROM job")
        assert not refused(role, "INSERT INTO heartbeat (name, at) VALUES ('x', 1) ON CONFLICT DO NOTHING")
        assert refused(role, "DROP TABLE job") and refused(role, "CREATE ROLE other")
        assert refused(role, "COPY job TO PROGRAM 'true'"), "a superuser runs programs"
        assert refused(role, "SELECT * FROM api_token") == (role == "apexcal_worker")
