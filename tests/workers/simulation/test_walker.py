import numpy as np
import pytest

from workers.simulation.scene import WALKER_REGION, Scene
from workers.simulation.walker import BOARD_EDGES_M, Walk
from workers.vertices.region import Region

_TIMES_S = np.arange(0.0, 120.0, 0.05)


@pytest.fixture(scope="module", params=[1, 2, 17])
def poses(request):
    return Walk(request.param, 120.0, Scene().ground_z).poses(_TIMES_S)


def test_the_board_is_a_rectangle_with_its_apex_on_top(poses):
    np.testing.assert_allclose(np.linalg.norm(poses.edge_left, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose((poses.edge_left * poses.edge_right).sum(axis=1), 0.0, atol=1e-12)
    for edge in (poses.edge_left, poses.edge_right):
        steep_deg = np.degrees(np.arcsin(-edge[:, 2]))
        assert steep_deg.min() > 35.0
        assert steep_deg.max() < 55.0


def test_the_board_never_touches_the_ground_and_the_head_stays_below_the_apex(poses):
    lowest = poses.apex + BOARD_EDGES_M[0] * poses.edge_left + BOARD_EDGES_M[1] * poses.edge_right
    assert lowest[:, 2].min() > Scene().ground_z
    assert (Scene().ground_z + poses.height < poses.apex[:, 2] - 0.1).all()


def test_the_walk_covers_the_field_at_walking_pace(poses):
    apex = poses.apex
    assert apex[:, 0].min() < 4.5
    assert apex[:, 0].max() > 28.0
    assert apex[:, 1].min() < -4.5
    assert apex[:, 1].max() > 4.5
    speed = np.linalg.norm(np.diff(apex[:, :2], axis=0), axis=1) / 0.05
    assert speed.max() < 2.5
    assert np.abs(np.diff(speed)).max() / 0.05 < 6.0  # no jumps
    elevation = np.degrees(np.arctan2(apex[:, 2], np.hypot(apex[:, 0], apex[:, 1])))
    assert elevation.max() - elevation.min() > 14.0


def test_the_region_that_goes_with_the_scene_holds_the_walkers_upper_body(poses):
    region = Region.from_document(WALKER_REGION)
    assert region.mask(poses.apex).all()
    chest = np.column_stack([poses.body, Scene().ground_z + 0.7 * poses.height])
    assert region.mask(chest).all()


def test_a_long_walk_goes_back_and_forth():
    apex = Walk(1, 600.0, Scene().ground_z).poses(np.arange(0.0, 600.0, 0.1)).apex
    step = np.linalg.norm(np.diff(apex, axis=0), axis=1)
    assert step.max() < 0.35
    assert apex[:, 0].max() < 31.0
