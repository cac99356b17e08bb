"""Bring the settings' database to the newest schema: ``python -m service.db.migrate``.

``python -m service.db.migrate --revise "what changes"`` writes the migration from the newest revision to the models.
"""

from __future__ import annotations

import argparse
import tempfile
from functools import cache
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy.engine import make_url

from service.db.session import open_engine
from service.settings import get_settings


def config(url: str) -> Config:
    """Alembic's configuration for a database."""
    found = Config()
    found.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
    found.attributes["url"] = url
    return found


@cache
def newest() -> str | None:
    """The newest revision that this code has."""
    return ScriptDirectory.from_config(config("")).get_current_head()


def upgrade(url: str) -> None:
    """Create or migrate the schema of ``url``. A second call, or one beside it, changes nothing."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite" and parsed.database:
        Path(parsed.database).parent.mkdir(parents=True, exist_ok=True)
    settings = config(url)
    engine = open_engine(url)
    try:
        with engine.execution_options(apexcal_writes=True).begin() as connection:
            settings.attributes["connection"] = connection
            command.upgrade(settings, "head")
    finally:
        engine.dispose()


def revise(message: str) -> None:
    """Write a new revision file: what leads from the newest revision to the models."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/scratch.db"
        upgrade(url)
        settings = config(url)
        number = len(list((Path(__file__).parent / "migrations/versions").glob("[0-9]*.py"))) + 1
        command.revision(settings, message=message, autogenerate=True, rev_id=f"{number:04d}")


def main() -> None:
    """Upgrade, or revise."""
    parser = argparse.ArgumentParser(prog="python -m service.db.migrate", description=__doc__)
    parser.add_argument("--revise", metavar="MESSAGE", help="write a new revision instead of migrating")
    chosen = parser.parse_args()
    if chosen.revise:
        revise(chosen.revise)
    else:
        upgrade(get_settings().database)


if __name__ == "__main__":
    main()
