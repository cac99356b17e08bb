"""Bring the settings' database to the newest schema: ``python -m service.platform.db.migrate``.

It may run while the service does. Two at once wait for each other. All revisions are one transaction.

``python -m service.platform.db.migrate --revise "what changes"`` writes the migration from the newest revision to the
models.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Engine, inspect, literal, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import OperationalError

from service.platform.db import grants
from service.platform.db.revisions import SCRIPTS, all_revisions, difference
from service.platform.db.session import open_engine
from service.platform.observability import logs
from service.platform.settings import settings_or_exit

# An arbitrary number: a migration holds this advisory lock.
_LOCK = 4_711_001


class NewerSchemaError(RuntimeError):
    """A newer version of apexcal has migrated the database."""


class OtherSchemaError(RuntimeError):
    """A development version of apexcal made the database, with other columns than this one's."""


def config(connection: Connection | None = None) -> Config:
    """Alembic's configuration, for commands on a connection."""
    settings = Config()
    settings.set_main_option("script_location", str(SCRIPTS))
    settings.attributes["connection"] = connection
    return settings


def upgrade(url: str, to: str = "head") -> None:
    """Create or migrate the schema of ``url``. A second call, or one beside it, changes nothing.

    Raises:
        sqlalchemy.exc.OperationalError: the database does not answer, or a lock was not free.
        NewerSchemaError: a newer version of apexcal migrated the database.
        OtherSchemaError: a development version made it.
    """
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite" and parsed.database:
        Path(parsed.database).parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    engine = open_engine(url, patient=True)
    try:
        with _locked(engine) as connection:
            _refuse_newer(connection)
            _refuse_other(connection)
            command.upgrade(config(connection), to)
    finally:
        engine.dispose()


def make_roles(url: str, roles: Mapping[str, str]) -> None:
    """Make the roles, by name with their passwords, with the rights of :mod:`service.platform.db.grants` alone."""
    engine = open_engine(url, patient=True)
    try:
        with _locked(engine) as connection:
            quoted = engine.dialect.identifier_preparer.quote
            for name, password in roles.items():
                exists = connection.scalar(text("SELECT 1 FROM pg_roles WHERE rolname = :name"), {"name": name})
                secret = literal(password).compile(engine, compile_kwargs={"literal_binds": True})
                role = quoted(name)
                login = f"{'ALTER' if exists else 'CREATE'} ROLE {role} LOGIN NOSUPERUSER PASSWORD {secret}"
                for statement in (login, *grants.statements(role, name)):
                    connection.exec_driver_sql(statement.replace("%", "%%"))
    finally:
        engine.dispose()


def _refuse_newer(connection: Connection) -> None:
    if not inspect(connection).has_table("alembic_version"):
        return
    revision = connection.scalar(text("SELECT version_num FROM alembic_version"))
    if revision is not None and revision not in all_revisions():
        raise NewerSchemaError(
            f"The database has revision {revision} of the schema; this version of apexcal knows {all_revisions()[0]} "
            "as the newest. Start the version that migrated the database, or a later one."
        )


def _refuse_other(connection: Connection) -> None:
    if inspect(connection).has_table("alembic_version") and (differing := difference(connection)):
        raise OtherSchemaError(
            f"A development version of apexcal made this database: {differing}. Such data are not taken over. Start "
            "the version that made it, or begin with an empty data folder or database and upload recordings again."
        )


@contextmanager
def _locked(engine: Engine) -> Iterator[Connection]:
    """A transaction that migrates while no other does. On SQLite it has the only write lock from its first moment."""
    with engine.execution_options(apexcal_writes=True).begin() as connection:
        if engine.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
            # A statement that waits for a table makes everybody after it wait too.
            connection.execute(text("SET LOCAL lock_timeout = '5s'"))
        yield connection


def revise(message: str) -> None:
    """Write a new revision file: what leads from the newest revision to the models."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/scratch.db"
        upgrade(url)
        engine = open_engine(url)
        with _locked(engine) as connection:
            number = f"{len(all_revisions()) + 1:04d}"
            command.revision(config(connection), message=message, autogenerate=True, rev_id=number)
        engine.dispose()


def main(arguments: Sequence[str] | None = None) -> None:
    """Upgrade, or revise."""
    parser = argparse.ArgumentParser(prog="python -m service.platform.db.migrate", description=__doc__)
    parser.add_argument("--revise", metavar="MESSAGE", help="write a new revision instead of migrating")
    chosen = parser.parse_args(arguments)
    if chosen.revise:
        revise(chosen.revise)
        return
    settings = settings_or_exit()
    logs.configure(settings.log_form)
    try:
        upgrade(settings.database)
        if settings.database_roles:
            make_roles(
                settings.database, {name: word.get_secret_value() for name, word in settings.database_roles.items()}
            )
    except (NewerSchemaError, OtherSchemaError) as error:
        sys.exit(str(error))
    except OperationalError as error:
        sys.exit(f"The schema was not changed: {error.orig}. Run it again.")


if __name__ == "__main__":
    main()
