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


def test_the_region_that_goes_with_the_scene_holds_the_walkers_upper_body(poses):
    region = Region.from_document(WALKER_REGION)
    assert region.mask(poses.apex).all()
    chest = np.column_stack([poses.body, Scene().ground_z + 0.7 * poses.height])
    assert region.mask(chest).all()


@pytest.mark.parametrize(
    ("plan", "usual", "fastest"),
    [
        ("rows", 0.3, 2.5), ("field", 0.6, 1.7), ("cover", 0.8, 1.5), ("yard", 0.4, 1.5), ("slow", 0.1, 0.35),
        ("still", 0.0, 0.01),
    ],
)  # fmt: skip
def test_every_walk_stays_in_the_field_and_goes_at_its_pace(plan, usual, fastest):
    apex = Walk(7, 90.0, -1.85, plan=plan).poses(np.arange(0.0, 90.0, 0.05)).apex
    speed = np.linalg.norm(np.diff(apex[:, :2], axis=0), axis=1) / 0.05
    assert speed.max() < fastest and np.median(speed) >= usual
    assert np.abs(np.diff(speed)).max() / 0.05 < 6.0  # no jumps
    assert 2.9 < apex[:, 0].min() <= apex[:, 0].max() < 32.5
    assert np.abs(apex[:, 1]).max() < 5.5
