"""A fleet with a vehicle and its rig, and the people who ask for its calibrations."""

from __future__ import annotations

import pytest

from tests.service.detections.seeding import seed_rig


@pytest.fixture
def fleet(api):
    return api.fleet()


@pytest.fixture
def rig(api, fleet):
    return seed_rig(api.database, fleet)


@pytest.fixture
def admin(api, fleet):
    return api.member(fleet, "admin")


@pytest.fixture
def engineer(api, fleet):
    return api.member(fleet, "engineer")


@pytest.fixture
def reviewer(api, fleet):
    return api.member(fleet, "reviewer", "Rea")


@pytest.fixture
def viewer(api, fleet):
    return api.member(fleet, "viewer")
