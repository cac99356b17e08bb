"""Opens the service's settings, database and store for one command, and turns faults into sentences."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Annotated, Any, ParamSpec
from uuid import UUID

import typer
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from apexcal.documents.base import visible
from service.platform.db.revisions import is_older, newest
from service.platform.db.session import Database
from service.platform.jobs.messages import COURIER, Sender
from service.platform.observability.logs import about
from service.platform.settings import Settings, SettingsError, get_settings
from service.platform.storage.errors import StoreFullError, StoreUnavailableError
from service.platform.storage.store import Store, open_store


class AdminError(Exception):
    """An operator's error; ``hint`` says what to do about it."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class WrongUsageError(AdminError):
    """An argument that could name nothing, whatever the service holds."""


FAILED, WRONG_USAGE = 1, 2
# The variable that holds what --data gave, as it was typed.
GIVEN_FOLDER = "APEXCAL_ADMIN_DATA"
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
P = ParamSpec("P")


@dataclass(frozen=True)
class Opened:
    """The database, store and settings that commands work on."""

    settings: Settings
    database: Database
    store: Store


@contextmanager
def opened() -> Iterator[Opened]:
    """The service of the environment. Raises :class:`AdminError` where its database is not there or not current."""
    settings = get_settings()
    file = settings.data_dir.resolve() / "apexcal.db"
    if not settings.database_url and not file.exists():
        raise AdminError(
            f"there is no service here: {file} does not exist",
            "Name its folder with --data, or give the command the service's environment (APEXCAL_DATABASE_URL).",
        )
    database = Database(settings.database, patient=True)
    sender = Sender(settings.broker)
    database.couriers[COURIER] = sender
    try:
        _refuse_other_schema(database)
        yield Opened(settings, database, open_store(settings))
    finally:
        sender.close()
        database.close()


def _refuse_other_schema(database: Database) -> None:
    with database.reading() as session:
        try:
            has = session.scalar(text("SELECT version_num FROM alembic_version"))
        except DBAPIError as error:
            raise AdminError(
                f"the database does not answer as apexcal's: {str(error.orig).strip().splitlines()[0]}",
                "Is APEXCAL_DATABASE_URL right, and did `python -m service.platform.db.migrate` run?",
            ) from None
    if has is None or is_older(has) or has != newest():
        raise AdminError(
            f"the schema is {has}, and this version's {newest()}",
            "Run `python -m service.platform.db.migrate`, or use the version that the service runs.",
        )


def spoken(command: Callable[P, Any]) -> Callable[P, None]:
    """A command whose faults are sentences on standard error, with exit code 1; 2 for wrong usage or settings."""

    name = f"{command.__module__.rpartition('.')[2].removesuffix('_commands')} {command.__name__}"

    @wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            with about(command=name):
                command(*args, **kwargs)
        except WrongUsageError as error:
            _complain(str(error), error.hint, WRONG_USAGE)
        except AdminError as error:
            _complain(str(error), error.hint)
        except SQLAlchemyError as error:
            lines = str(getattr(error, "orig", None) or error).strip().splitlines()
            _complain(f"the database: {lines[0] if lines else type(error).__name__}", "")
        except SettingsError as error:
            _complain(str(error), "Give the command the environment that the service has.", WRONG_USAGE)
        except (StoreUnavailableError, StoreFullError) as error:
            _complain(str(error.strerror), f"The store is {get_settings().blobs}.")
        except OSError as error:
            _complain(f"{error.filename or 'the disk'}: {error.strerror or error}", "")

    return run


def _complain(sentence: str, hint: str, code: int = FAILED) -> None:
    print(f"apexcal admin: {visible(sentence)}.", file=sys.stderr)
    if hint:
        print(hint, file=sys.stderr)
    raise typer.Exit(code)


def command(words: str) -> str:
    """A command of this program as it is to be typed now: on the folder that this one was given, where it was."""
    folder = os.environ.get(GIVEN_FOLDER)
    data = f"--data {shlex.quote(folder)} " if folder else ""
    return f"`{program()} {data}{words}`"


def program() -> str:
    """Return the name under which this program was called."""
    return os.environ.get("APEXCAL_COMMAND", "python -m service.admin")


def as_id(text: str, what: str, hint: str) -> UUID:
    """An id as people copy it. Raises :class:`WrongUsageError` for what is none."""
    try:
        return UUID(text)
    except ValueError:
        raise WrongUsageError(f"{text!r} is no id of a {what}", hint) from None


def table(rows: list[dict[str, Any]], columns: tuple[str, ...]) -> str:
    """Rows as aligned text, one line each, under their columns' names."""
    lines = [columns, *(tuple(_cell(row[name]) for name in columns) for row in rows)]
    widths = [max(len(line[number]) for line in lines) for number in range(len(columns))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )


def _cell(value: Any) -> str:
    return visible(str(value)) if value is not None else "-"
