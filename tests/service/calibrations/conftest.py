"""People who ask for a vehicle's calibrations."""

from __future__ import annotations

import pytest


@pytest.fixture
def admin(api, fleet):
    return api.member(fleet, "admin")


@pytest.fixture
def reviewer(api, fleet):
    return api.member(fleet, "reviewer", "Rea")
