"""``apexcal admin``, or ``python -m service.admin``: an operator's commands, on the service's own settings."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Annotated

import typer

from apexcal.documents.served_folder import is_served
from service.admin.backup import back_up
from service.admin.context import FAILED, GIVEN_FOLDER, AdminError, opened, program, spoken
from service.admin.forecast_commands import forecast
from service.admin.job_commands import job, jobs, requeue
from service.admin.manifest import Manifest, verify
from service.admin.people_commands import audit, tokens, users
from service.admin.quota_commands import quota
from service.admin.restore import restore as bring_back
from service.admin.retention_commands import retention
from service.platform.settings import get_settings
from service.platform.storage.store import open_store

_HELP = """Look after a service: back up and restore, people, jobs, retention, quotas.

It works on the service's own database and store: those of the folder that --data names, or those of the environment
(APEXCAL_DATABASE_URL, APEXCAL_BLOB_URL and the rest, as the service has them). Exit codes: 0 done; 1 refused or
failed; 2 wrong usage.
"""

app = typer.Typer(
    help=_HELP, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
)
app.add_typer(users, name="users")
app.add_typer(tokens, name="tokens")
app.add_typer(retention, name="retention")
app.add_typer(quota, name="quota")
for command in (jobs, job, requeue, audit, forecast):
    app.command(command.__name__)(command)


@app.callback()
def admin(
    data: Annotated[Path | None, typer.Option(help="Data folder of an `apexcal serve` on this machine.")] = None,
) -> None:
    """See ``_HELP``."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s %(message)s")
    os.environ.pop(GIVEN_FOLDER, None)
    if data is not None:
        os.environ[GIVEN_FOLDER] = str(data)
        os.environ["APEXCAL_DATA_DIR"] = str(data.resolve())
        for name in ("APEXCAL_DATABASE_URL", "APEXCAL_BLOB_URL", "APEXCAL_BROKER_URL"):
            os.environ.pop(name, None)
        get_settings.cache_clear()


@app.command()
@spoken
def backup(
    target: Annotated[Path, typer.Argument(help="A folder that does not exist yet.")],
    quiet: Annotated[bool, typer.Option("--quiet", help="Say nothing but what is wrong.")] = False,
) -> None:
    """Back up database and objects while the service works.

    What is written is of one moment: every row, and every object that a row names. Nothing is removed from the store
    meanwhile. The folder is complete or not there: it appears in one step. Objects that the store lost or changed,
    or cannot read are named, and the exit code is 1; everything else is in the backup all the same.
    """
    with opened() as service:
        manifest = back_up(service.database, service.store, target.resolve(), report=_reporter(quiet))
    if not quiet:
        print(f"{target}: {sum(manifest.rows.values())} rows, {manifest.blobs} objects, {manifest.blob_bytes} bytes.")
    if _name_damaged(manifest):
        print(
            "All else is backed up. Bring these objects back from an earlier backup, or delete their recordings.",
            file=sys.stderr,
        )
        raise typer.Exit(FAILED)


@app.command()
@spoken
def restore(
    source: Annotated[Path, typer.Argument(help="A folder that `backup` wrote.")],
    check: Annotated[bool, typer.Option("--check", help="Only check that every file of it is whole.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Say nothing but what is wrong.")] = False,
) -> None:
    """Bring a backup back into an empty service.

    The database and the store must be empty, and no service may run on them. They may be of another kind: a backup
    of SQLite and a folder may go to PostgreSQL and S3, and the other way round.
    """
    if check:
        manifest, blobs = verify(source.resolve())
        if not quiet:
            how = "holds what could be backed up" if manifest.damaged else "is whole"
            print(
                f"{source} {how}: {sum(manifest.rows.values())} rows, {len(blobs)} objects, made {manifest.made_at}."
            )
        if _name_damaged(manifest):
            raise typer.Exit(FAILED)
        return
    settings = get_settings()
    own = nullcontext() if settings.database_url else _made(settings.data_dir)
    with own:
        manifest = bring_back(settings.database, open_store(settings), source.resolve(), report=_reporter(quiet))
    if not quiet:
        print(f"Restored what was backed up {manifest.made_at}. Start the service.")
    _name_damaged(manifest)


def _name_damaged(manifest: Manifest) -> bool:
    """Say on standard error which objects were not whole when the backup was made; whether there are any."""
    for object in manifest.damaged:
        print(f"{object.key}: {object.what}", file=sys.stderr)
    if manifest.damaged:
        print(
            f"apexcal admin: the store had lost, changed or could not read {len(manifest.damaged)} objects when this "
            "was backed up.",
            file=sys.stderr,
        )
    return bool(manifest.damaged)


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """The folder, made where it is missing; a refusal in the block takes with it what is empty of it."""
    if is_served(folder):
        raise AdminError(f"a service runs on {folder}", "Stop it first, or restore into another folder.")
    missing = [path for path in (folder / "blobs", folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # what has something in it stays, and so does all above
            for path in missing:
                path.rmdir()
        raise


def _reporter(quiet: bool):  # noqa: ANN202 - a function of one line
    return (lambda line: None) if quiet else (lambda line: print(line, file=sys.stderr, flush=True))


if __name__ == "__main__":
    # Backups, links and restored databases are the operator's alone.
    os.umask(0o077)
    app(prog_name=program())
