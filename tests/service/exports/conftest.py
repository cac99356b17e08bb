"""A rig that states where its LiDAR is, and a result that was published for it."""

import pytest

from tests.service.calibrations.test_results import T_VEHICLE_LIDAR, seed_results
from tests.service.detections.seeding import seed_rig


@pytest.fixture
def rig(api, fleet):
    return seed_rig(api.database, fleet, T_vehicle_lidar=T_VEHICLE_LIDAR)


@pytest.fixture
def result(api, fleet, rig):
    _, (full, _) = seed_results(api, rig)
    assert api.member(fleet, "reviewer").post(f"/results/{full}/publication").status_code == 201
    return full
