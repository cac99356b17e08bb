"""Each disturbance does what it says."""

import numpy as np
import pytest

from apexcal.documents.simulation import Disturbances
from tests.workers.simulation.scans import ranges, scanned
from workers.simulation.lidar import BOARD, BOX, PERSON, POLE, SECOND_PERSON, SPECKLE, WALL
from workers.simulation.scene import Scene, scene_with
from workers.simulation.walker import BOARD_EDGES_M, BoardHold, Walk

MINUTE_S = np.arange(0.5, 59.0, 2.5)


def beyond_edges(scan):
    """How far each board point lies beyond the upper edges, in metres and as an angle at its range."""
    on = scan.label == BOARD
    apex, left, right = (field[on] for field in scan.joined("apex", "edge_left", "edge_right"))
    from_apex = scan.xyz[on] - apex
    beyond = -np.minimum((from_apex * left).sum(axis=1), (from_apex * right).sum(axis=1))
    return beyond, beyond / ranges(scan.xyz[on])


def test_a_wide_beam_makes_the_edges_grow_by_half_of_it():
    thin_m, _ = beyond_edges(scanned(plan="field", starts_s=MINUTE_S))
    assert thin_m.max() < 0.004
    _, wide_rad = beyond_edges(scanned(Disturbances(beam_mrad=3.0), plan="field", starts_s=MINUTE_S))
    assert 0.0012 < wide_rad.max() < 0.0022  # the rim is round, the edge is seen at a slant
    assert np.mean(wide_rad > 0.0003) > 0.03


def test_returns_are_lost_at_the_rate_and_specks_hide_what_is_behind_them():
    clear, holed, dusty = (scanned(one) for one in (None, Disturbances(dropouts=0.2), Disturbances(speckle=0.05)))
    assert len(holed.label) / len(clear.label) == pytest.approx(0.8, abs=0.01)
    specks = dusty.xyz[dusty.label == SPECKLE]
    assert len(specks) == pytest.approx(0.05 * 4 * 599 * 16, rel=0.15)
    assert np.median(ranges(specks)) < 4.0 and specks[:, 2].min() > Scene().ground_z  # none below the ground
    assert np.count_nonzero(dusty.label == WALL) < 0.97 * np.count_nonzero(clear.label == WALL)


@pytest.mark.parametrize("where", ["beside", "behind"])
def test_a_second_person_goes_along(where):
    scan = scanned(Disturbances(second_person=where), plan="field", starts_s=MINUTE_S)
    poses = scan.walk.poses(MINUTE_S)
    body, other = poses.body, poses.second.body
    assert np.count_nonzero(scan.label == SECOND_PERSON) > len(MINUTE_S)
    apart = np.linalg.norm(other - body, axis=1)
    assert 0.35 < apart.min() < apart.max() < 1.4  # two bodies do not overlap
    farther = np.linalg.norm(other, axis=1) - np.linalg.norm(body, axis=1)
    assert (farther.min() > 0.3) if where == "behind" else (np.abs(farther).max() < 0.6)


def test_the_head_is_above_the_board_only_when_asked():
    for disturbances, above in ((None, False), (Disturbances(head_above_m=0.1), True)):
        poses = Walk(2, 60.0, 0.0, disturbances=disturbances).poses(np.arange(0.0, 60.0, 0.1))
        over = poses.height - poses.apex[:, 2]
        assert (over.min() > 0.08) if above else (over.max() < -0.12)
        lowest = poses.apex + BOARD_EDGES_M[0] * poses.edge_left + BOARD_EDGES_M[1] * poses.edge_right
        assert lowest[:, 2].min() > 0.0


def test_taller_walkers_lift_the_board_higher():
    walks = [Walk(2, 60.0, 0.0, disturbances=Disturbances(walker_height_m=tall)) for tall in (1.5, 1.74, 2.0)]
    heights = [walk.poses(np.arange(0.0, 60.0, 0.1)).apex[:, 2] for walk in walks]
    assert heights[0].max() + 0.2 < heights[1].max() < heights[2].max() - 0.2
    assert np.min(heights) > 1.0


def test_poles_stand_inside_the_field():
    scene = scene_with(4, seed=3)
    added = scene.poles[len(Scene().poles) :]
    assert len(added) == 4 and np.abs(added[:, 1]).max() <= 3.0
    scan = scanned(scene=scene)
    assert np.any(np.abs(scan.xyz[scan.label == POLE, 1]) < 3.1)


def test_larger_boards_stay_off_the_ground_and_lose_their_points_to_no_edge():
    scan = scanned(sensor="hdl64", board_m=(1.0, 0.8))
    poses = scan.walk.poses(np.arange(0.0, 60.0, 0.1))
    assert (poses.apex + 1.0 * poses.edge_left + 0.8 * poses.edge_right)[:, 2].min() > Scene().ground_z
    apex, left = scan.joined("apex", "edge_left")
    along = ((scan.xyz - apex) * left).sum(axis=1)[scan.label == BOARD]
    assert 0.9 < along.max() < 1.005


def test_hands_are_at_the_lower_edges_and_hide_some_of_the_board():
    plain, gripped = (scanned(sensor="os1-128", hold=hold) for hold in (None, BoardHold(hand_m=0.06)))
    seen = [np.count_nonzero(scan.label == BOARD) for scan in (plain, gripped)]
    assert 0.7 * seen[0] < seen[1] < seen[0]
    poses = gripped.walk.poses(np.arange(1.0, 11.0))
    from_apex = poses.hands[:, :, :3] - poses.apex[:, None]
    edges = np.stack([poses.edge_left, poses.edge_right])
    along = np.einsum("tha,eta->the", from_apex, edges)
    assert along[:, :2].max(axis=2).min() > BOARD_EDGES_M[0] - 0.01  # on the edges away from the apex


def test_a_coat_is_wider_than_a_shirt():
    shirt, coat = (
        scanned(sensor="os1-128", hold=BoardHold(torso_m=torso_m, body_behind_m=0.3)) for torso_m in (0.13, 0.22)
    )
    assert np.count_nonzero(coat.label == PERSON) > 1.1 * np.count_nonzero(shirt.label == PERSON)


def test_boxes_stand_where_they_are_said_to():
    scan = scanned(scene=Scene(boxes=np.array([[20.0, 0.0, 0.3, 2.0, 0.9, 0.2, 1.6]])))
    x, y, z = (scan.xyz[scan.label == BOX] - (20.0, 0.0, Scene().ground_z)).T
    assert len(x) > 100
    c, s = np.cos(0.3), np.sin(0.3)
    inside = np.stack([2.0 - np.abs(c * x + s * y), 0.9 - np.abs(c * y - s * x), 1.6 - z, z - 0.2])
    assert inside.min() > -0.01
    assert np.abs(inside[:3].min(axis=0)).max() < 0.01  # on a face
