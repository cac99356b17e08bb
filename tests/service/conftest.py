"""A rig of the fleet, and who looks at its results."""

from uuid import UUID

import pytest

from tests.support.people import Actor, Api


@pytest.fixture
def viewer(api: Api, fleet: UUID) -> Actor:
    """A person who may only read."""
    return api.member(fleet, "viewer")


@pytest.fixture
def reviewer(api: Api, fleet: UUID) -> Actor:
    """A person who may publish."""
    return api.member(fleet, "reviewer", "Rea")
