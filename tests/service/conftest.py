"""Who looks at a fleet's results, and a recording that is on its way."""

from typing import Any
from uuid import UUID

import pytest

from tests.support.people import Actor, Api
from tests.support.uploads import new_recording


@pytest.fixture
def viewer(api: Api, fleet: UUID) -> Actor:
    """A person who may only read."""
    return api.member(fleet, "viewer")


@pytest.fixture
def reviewer(api: Api, fleet: UUID) -> Actor:
    """A person who may publish."""
    return api.member(fleet, "reviewer", "Rea")


@pytest.fixture
def recording(engineer: Actor, fleet: UUID) -> dict[str, Any]:
    """A recording that waits for its parts."""
    return new_recording(engineer, fleet)
