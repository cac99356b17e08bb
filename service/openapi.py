"""Write the description of the API: ``python -m service.openapi FILE``. The pages' types are generated from it."""

from __future__ import annotations

import json
import logging
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from service.app import create_app
from service.platform.settings import Settings


def document() -> str:
    """The OpenAPI document that ``/v1/openapi.json`` answers. Needs no running service and no environment."""
    with TemporaryDirectory() as folder:
        app = create_app(Settings(data_dir=Path(folder), database_url="", blob_url="", uploads="api"))
        try:
            return json.dumps(app.openapi(), ensure_ascii=False, indent=1)
        finally:
            app.state.database.close()


if __name__ == "__main__":
    # The empty folder has no database yet, which the application would log.
    logging.disable()
    target, now = Path(sys.argv[1]), document()
    # A file that would stay the same keeps its time, so that make builds nothing anew because of it.
    if not target.exists() or target.read_text(encoding="utf-8") != now:
        target.write_text(now, encoding="utf-8")
