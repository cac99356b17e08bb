"""What is stored is stored as on one machine (SQLite and a folder) and as in a fleet (PostgreSQL and S3)."""

from collections.abc import Callable
from typing import Any

import pytest

from service.platform.settings import Settings
from tests.support.people import Api
from tests.support.s3 import S3Server


@pytest.fixture
def on_s3(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Settings of a service that keeps its blobs in a fresh bucket."""
    server: S3Server = request.getfixturevalue("s3_server")
    return server.settings(server.make_bucket())


@pytest.fixture
def api(make_api: Callable[..., Api], settings: Settings, request: pytest.FixtureRequest) -> Api:
    """The served application."""
    fleet = settings.database.startswith("postgresql")
    return make_api(**request.getfixturevalue("on_s3")) if fleet else make_api()
