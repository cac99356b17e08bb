"""Drawn sensors and scenes are wide, repeatable, and hold the board in their region."""

import numpy as np
import pytest

from tests.support.scenes.drawn import draw, draw_street
from workers.simulation.lidar import BOARD, PERSON, SECOND_PERSON
from workers.vertices.region import Region


def test_a_seed_gives_the_same_sweep_and_another_seed_another_sensor():
    first, again = (draw(7).simulated(2.0)[1].sweep(3, 0.3, 0) for _ in range(2))
    np.testing.assert_array_equal(first.xyz, again.xyz)
    draws = [draw(seed) for seed in range(60)]
    assert len({drawn.sensor.name for drawn in draws}) == 10
    assert {drawn.plan for drawn in draws} == {"field", "yard", "cover"}
    assert {drawn.sensor.rate_hz for drawn in draws} == {5.0, 10.0, 20.0}
    rolls, tilts, seams, pitches = np.transpose(
        [(one.hold.rolled_deg, one.hold.tilted_deg, one.mount.seam_deg, one.mount.pitch_deg) for one in draws]
    )
    assert min(np.ptp(rolls), np.ptp(tilts)) > 15.0 and np.ptp(seams) > 200.0 and np.ptp(pitches) > 8.0
    assert np.ptp([one.noise_m for one in draws]) > 0.01 and np.ptp([one.board_m[0] for one in draws]) > 0.5


@pytest.mark.parametrize("seed", [1, 4, 6, 9])
def test_the_region_holds_the_board_and_no_ground(seed):
    drawn = draw(seed)
    walk, lidar = drawn.simulated(3.0)
    region = Region.from_document(drawn.region())
    held, upper = [], []
    for index in range(3):
        sweep, label = lidar.labelled_sweep(index, float(index), 0)
        inside = region.mask(sweep.xyz)
        poses = walk.poses(float(index) + sweep.offset_ns * 1e-9)
        below = np.linalg.norm(sweep.xyz - lidar.seen(poses.apex), axis=1)
        held.append(inside[label == BOARD])
        upper.append(inside[(label == BOARD) & (below < 0.6)])
        level = sweep.xyz[inside] @ drawn.mount.rotation().T
        assert (level[:, 2] - drawn.scene.ground_z).min(initial=1.0) > 0.05
    assert len(np.concatenate(held)) > 20
    assert np.mean(np.concatenate(held)) > 0.7
    assert np.concatenate(upper).all()


def test_a_street_has_people_and_no_board():
    met = set()
    for seed in range(4):
        drawn = draw_street(seed)
        _, lidar = drawn.simulated(1.0)
        _, label = lidar.labelled_sweep(0, 0.0, 0)
        met |= set(label.tolist())
    assert BOARD not in met
    assert {PERSON, SECOND_PERSON} <= met
