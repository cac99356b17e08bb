"""The revisions of the schema that this code has, by their files' names, without Alembic."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from sqlalchemy import Connection, inspect, text
from sqlalchemy.orm import Session

from service.platform.db.models import Base

SCRIPTS = Path(__file__).parent / "migrations"


@cache
def all_revisions() -> tuple[str, ...]:
    """The revisions, the newest first. A file is named ``<revision>_<what it changes>.py``; revisions count up."""
    names = [file.name.partition("_")[0] for file in (SCRIPTS / "versions").glob("[0-9]*_*.py")]
    return tuple(sorted(names, reverse=True))


def stored(session: Session) -> str | None:
    """The revision of the database. Raises :class:`sqlalchemy.exc.DBAPIError` where it was never migrated."""
    return session.scalar(text("SELECT version_num FROM alembic_version"))


def newest() -> str:
    """The newest revision."""
    return all_revisions()[0]


def is_older(revision: str) -> bool:
    """Whether a schema lacks what this code needs. One that this code does not know is newer."""
    return revision in all_revisions()[1:]


def difference(connection: Connection) -> str | None:
    """What a database of the newest revision has otherwise than the models, in words; None of an older revision.

    A development version wrote that revision as its models were then.
    """
    if connection.scalar(text("SELECT version_num FROM alembic_version")) != newest():
        return None
    tables = {name: columns for (_, name), columns in inspect(connection).get_multi_columns().items()}
    for name, table in Base.metadata.tables.items():
        differing = {column["name"] for column in tables.get(name, ())} ^ set(table.columns.keys())
        if differing:
            return f"its table {name} differs in {', '.join(sorted(differing))}"
    return None
