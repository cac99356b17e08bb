"""A rig of the fleet, and who looks at its results."""

from uuid import UUID

import pytest

from service.platform.db.fleets import Rig
from tests.service.detections.seeding import seed_rig
from tests.support.people import Actor, Api


@pytest.fixture
def rig(api: Api, fleet: UUID) -> Rig:
    """A rig with one camera."""
    return seed_rig(api.database, fleet)


@pytest.fixture
def viewer(api: Api, fleet: UUID) -> Actor:
    """A person who may only read."""
    return api.member(fleet, "viewer")


@pytest.fixture
def reviewer(api: Api, fleet: UUID) -> Actor:
    """A person who may publish."""
    return api.member(fleet, "reviewer", "Rea")
