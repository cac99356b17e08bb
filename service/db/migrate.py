"""Bring the settings' database to the newest schema: ``python -m service.db.migrate``.

It may run while an older version serves, and beside another of its kind: two at once wait for each other. On
PostgreSQL each revision is a transaction of its own that waits for a lock two seconds at most, then steps aside and
tries again: a statement that waits for a table makes everybody after it wait too.

``python -m service.db.migrate --revise "what changes"`` writes the migration from the newest revision to the models.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Engine, inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import OperationalError

from service.db.revisions import SCRIPTS, known, newest
from service.db.session import open_engine
from service.observability import logs
from service.settings import settings_or_exit

# An arbitrary number: a migration holds this advisory lock.
_LOCK = 4_711_001
_LOCK_TIMEOUT_S = 2
_PATIENCE_S = 300.0
_LOOKS_AGAIN_S = 0.2

log = logging.getLogger(__name__)


class NewerSchemaError(RuntimeError):
    """A newer version of apexcal has migrated the database."""


def config(url: str) -> Config:
    """Alembic's configuration for a database."""
    found = Config()
    found.set_main_option("script_location", str(SCRIPTS))
    found.attributes["url"] = url
    return found


def upgrade(url: str, to: str = "head", *, patience_s: float = _PATIENCE_S) -> None:
    """Create or migrate the schema of ``url``. A second call, or one beside it, changes nothing.

    Raises :class:`sqlalchemy.exc.OperationalError` where the locks that it needs are not free within ``patience_s``,
    and :class:`NewerSchemaError`.
    """
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite" and parsed.database:
        Path(parsed.database).parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    engine = open_engine(url, patient=True)
    try:
        _refuse_newer(engine)
        _with_patience(engine, url, to, time.monotonic() + patience_s)
    finally:
        engine.dispose()


def _refuse_newer(engine: Engine) -> None:
    with engine.connect() as connection:
        if not inspect(connection).has_table("alembic_version"):
            return
        revision = connection.scalar(text("SELECT version_num FROM alembic_version"))
    if revision is not None and revision not in known():
        raise NewerSchemaError(
            f"The database has revision {revision} of the schema; this version of apexcal knows {known()[0]} as the "
            "newest. Start the version that migrated the database, or a later one."
        )


def _with_patience(engine: Engine, url: str, to: str, deadline: float) -> None:
    nap_s = 0.5
    while True:
        try:
            with _alone(engine) as connection:
                settings = config(url)
                settings.attributes["connection"] = connection
                command.upgrade(settings, to)
            return
        except OperationalError as error:
            if not _is_of_a_lock(error) or time.monotonic() + nap_s > deadline:
                raise
            log.warning("a long transaction holds a table that the migration changes; trying again in %g s", nap_s)
        time.sleep(nap_s)
        nap_s = min(2 * nap_s, 8.0)


@contextmanager
def _alone(engine: Engine) -> Iterator[Connection]:
    """A connection that migrates while no other does."""
    if engine.dialect.name == "sqlite":
        # Everything in one transaction, which has the database's only write lock from its first moment.
        with engine.execution_options(apexcal_writes=True).begin() as connection:
            yield connection
        return
    with engine.connect() as connection:
        # Polled: a statement that waited for the lock would itself hold up an index that is built concurrently.
        while not connection.scalar(text("SELECT pg_try_advisory_lock(:lock)"), {"lock": _LOCK}):
            connection.rollback()
            time.sleep(_LOOKS_AGAIN_S)
        connection.execute(text(f"SET lock_timeout = '{_LOCK_TIMEOUT_S}s'"))
        connection.commit()
        try:
            yield connection
        finally:
            # The lock is the connection's: it ends with it, also when this process is killed.
            connection.rollback()
            connection.invalidate()


def _is_of_a_lock(error: OperationalError) -> bool:
    return type(error.orig).__name__ == "LockNotAvailable" or "database is locked" in str(error.orig)


def revise(message: str) -> None:
    """Write a new revision file: what leads from the newest revision to the models."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/scratch.db"
        upgrade(url)
        settings = config(url)
        engine = open_engine(url)
        with _alone(engine) as connection:
            settings.attributes["connection"] = connection
            command.revision(settings, message=message, autogenerate=True, rev_id=f"{int(newest()) + 1:04d}")
        engine.dispose()


def main(arguments: Sequence[str] | None = None) -> None:
    """Upgrade, or revise."""
    parser = argparse.ArgumentParser(prog="python -m service.db.migrate", description=__doc__)
    parser.add_argument("--revise", metavar="MESSAGE", help="write a new revision instead of migrating")
    chosen = parser.parse_args(arguments)
    if chosen.revise:
        revise(chosen.revise)
        return
    settings = settings_or_exit()
    logs.configure(settings.log_form)
    try:
        upgrade(settings.database)
    except NewerSchemaError as error:
        sys.exit(str(error))
    except OperationalError as error:
        sys.exit(f"The schema was not changed completely: {error.orig}. Every step is whole or absent; run it again.")


if __name__ == "__main__":
    main()
