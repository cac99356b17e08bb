"""Make ready what the service needs at its start, in one process: ``python -m service.prepare --token-file FILE``.

The schema, the store's folder and the owner. Each has a command of its own too (``service.platform.db.migrate``,
``service.platform.storage.prepare``, ``service.platform.auth.bootstrap``), which would spend its time on the
same imports.
"""

from __future__ import annotations

import argparse
import sys

from sqlalchemy.exc import DBAPIError

from service.platform.auth import bootstrap
from service.platform.db.revisions import difference, newest, stored
from service.platform.db.session import Database
from service.platform.settings import settings_or_exit
from service.platform.storage import prepare as storage


def main() -> int:
    """0 where everything is ready; the owner's one-time link is printed then."""
    parser = argparse.ArgumentParser(prog="python -m service.prepare", description=__doc__)
    parser.add_argument(
        "--token-file", required=True, help="write an API token of the owner to this file (mode 0600)"
    )
    parser.add_argument("--mark", action="store_true", help="mark the folder of objects as the database's own")
    chosen = parser.parse_args()
    if not _is_current():
        # Imported here: Alembic takes longer to import than this look at what there is to do.
        from service.platform.db import migrate

        migrate.main([])
    if chosen.mark and (code := storage.main([])):
        return code
    bootstrap.main(["--token-file", chosen.token_file])
    return 0


def _is_current() -> bool:
    database = Database(settings_or_exit().database)
    try:
        with database.reading() as session:
            return stored(session) == newest() and difference(session.connection()) is None
    except DBAPIError:
        return False
    finally:
        database.close()


if __name__ == "__main__":
    sys.exit(main())
