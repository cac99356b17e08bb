"""A worker's context on this test's database."""

from collections.abc import Iterator

import pytest

from service.settings import Settings
from workers.tasks.context import Context


@pytest.fixture
def context(settings: Settings) -> Iterator[Context]:
    made = Context(settings)
    yield made
    made.database.close()
