"""Which revisions of the schema this code has, told by the names of the files: Alembic is not needed for that."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from sqlalchemy import text
from sqlalchemy.orm import Session

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
