"""Each disturbance does what it says, and the labels say what each point lies on."""

import numpy as np
import pytest

from workers.simulation.disturbances import Disturbances
from workers.simulation.lidar import (
    BOARD,
    GROUND,
    PERSON,
    POLE,
    SECOND_PERSON,
    SENSORS,
    SPECKLE,
    WALL,
    Lidar,
)  # fmt: skip
from workers.simulation.scene import Scene, scene_with
from workers.simulation.walker import BOARD_EDGES_M, Walk
from workers.simulation.walks import WALKS

_AT_S = np.arange(0.5, 59.0, 2.5)


def scanned(disturbances=None, *, sensor="vlp16", plan="field", seed=5, scene=None):
    """Sweeps over a minute with their labels and the true poses at each point's time."""
    scene = scene or Scene()
    walk = Walk(seed, 60.0, scene.ground_z, plan=plan, disturbances=disturbances)
    lidar = Lidar(SENSORS[sensor], scene, walk, sector_deg=55.0, noise_m=0.0, seed=seed, disturbances=disturbances)
    sweeps = [lidar.labelled_sweep(index, start_s, 0) for index, start_s in enumerate(_AT_S)]
    return walk, sweeps


def outside_edges(walk, sweeps):
    """How far each board point lies beyond the upper edges, in metres and as an angle at its range."""
    beyond, angle = [], []
    for start_s, (sweep, label) in zip(_AT_S, sweeps, strict=True):
        on = label == BOARD
        poses = walk.poses(start_s + sweep.offset_ns[on] * 1e-9)
        from_apex = sweep.xyz[on] - poses.apex
        out = -np.minimum((from_apex * poses.edge_left).sum(axis=1), (from_apex * poses.edge_right).sum(axis=1))
        beyond.append(out)
        angle.append(out / np.linalg.norm(sweep.xyz[on], axis=1))
    return np.concatenate(beyond), np.concatenate(angle)


def test_labels_say_what_a_point_lies_on():
    walk, sweeps = scanned()
    ground_z, wall_x = Scene().ground_z, Scene().wall_x
    for start_s, (sweep, label) in zip(_AT_S, sweeps, strict=True):
        assert len(label) == len(sweep.xyz)
        assert set(label.tolist()) <= {GROUND, WALL, POLE, BOARD, PERSON}
        np.testing.assert_allclose(sweep.xyz[label == GROUND][:, 2], ground_z, atol=0.005)
        np.testing.assert_allclose(sweep.xyz[label == WALL][:, 0], wall_x, atol=0.005)
        poses = walk.poses(start_s + sweep.offset_ns * 1e-9)
        plane = ((sweep.xyz - poses.apex) * np.cross(poses.edge_left, poses.edge_right)).sum(axis=1)
        assert np.abs(plane[label == BOARD]).max(initial=0.0) < 0.003
        body = np.linalg.norm(sweep.xyz[:, :2] - poses.body, axis=1)
        assert body[label == PERSON].max(initial=0.0) < 0.2
    assert sum(np.count_nonzero(label == BOARD) for _, label in sweeps) > 150


def test_a_wide_beam_makes_the_edges_grow_by_half_of_it():
    thin_m, _ = outside_edges(*scanned())
    assert thin_m.max() < 0.004
    _, wide_rad = outside_edges(*scanned(Disturbances(beam_mrad=3.0)))
    assert 0.0012 < wide_rad.max() < 0.0022  # the rim is round, the edge is seen at a slant
    assert np.mean(wide_rad > 0.0003) > 0.03


def test_returns_are_lost_at_the_rate_that_was_asked_for():
    _, whole = scanned()
    _, holed = scanned(Disturbances(dropout_share=0.2))
    kept = sum(len(label) for _, label in holed) / sum(len(label) for _, label in whole)
    assert kept == pytest.approx(0.8, abs=0.01)


def test_specks_hang_in_the_air_and_hide_what_is_behind_them():
    _, clear = scanned()
    _, sweeps = scanned(Disturbances(speckle_share=0.05))
    specks = np.concatenate([sweep.xyz[label == SPECKLE] for sweep, label in sweeps])
    beams = len(_AT_S) * 549 * 16
    assert len(specks) == pytest.approx(0.05 * beams, rel=0.1)
    assert np.median(np.linalg.norm(specks, axis=1)) < 4.0
    assert sum(np.count_nonzero(label == WALL) for _, label in sweeps) < 0.97 * sum(
        np.count_nonzero(label == WALL) for _, label in clear
    )


@pytest.mark.parametrize("where", ["beside", "behind"])
def test_a_second_person_goes_along(where):
    walk, sweeps = scanned(Disturbances(second_person=where))
    seen = [sweep.xyz[label == SECOND_PERSON] for sweep, label in sweeps]
    assert np.mean([len(points) > 0 for points in seen]) > 0.8
    poses = walk.poses(_AT_S)
    apart = np.linalg.norm(poses.second.body - poses.body, axis=1)
    assert apart.min() > 0.35  # two bodies do not overlap
    assert apart.max() < 1.4
    farther = np.linalg.norm(poses.second.body, axis=1) - np.linalg.norm(poses.body, axis=1)
    assert (farther.min() > 0.3) if where == "behind" else (np.abs(farther).max() < 0.6)


def test_the_head_is_above_the_board_only_when_asked():
    scene = Scene()
    for disturbances, above in ((None, False), (Disturbances(head_above_m=0.1), True)):
        poses = Walk(2, 60.0, scene.ground_z, disturbances=disturbances).poses(np.arange(0.0, 60.0, 0.1))
        over = scene.ground_z + poses.height - poses.apex[:, 2]
        assert (over.min() > 0.08) if above else (over.max() < -0.12)
        lowest = poses.apex + BOARD_EDGES_M[0] * poses.edge_left + BOARD_EDGES_M[1] * poses.edge_right
        assert lowest[:, 2].min() > scene.ground_z


def test_taller_walkers_lift_the_board_higher():
    heights = [
        Walk(2, 60.0, 0.0, disturbances=Disturbances(walker_height_m=tall)).poses(np.arange(0.0, 60.0, 0.1))
        for tall in (1.5, 1.74, 2.0)
    ]
    tops = [poses.apex[:, 2].max() for poses in heights]
    assert tops[0] + 0.2 < tops[1] < tops[2] - 0.2
    assert min(poses.apex[:, 2].min() for poses in heights) > 1.0


def test_poles_stand_inside_the_field():
    scene = scene_with(4, seed=3)
    added = scene.poles[len(Scene().poles) :]
    assert len(added) == 4
    assert np.abs(added[:, 1]).max() <= 3.0
    _, sweeps = scanned(scene=scene)
    points = np.concatenate([sweep.xyz[label == POLE] for sweep, label in sweeps])
    assert np.any(np.abs(points[:, 1]) < 3.1)


def test_larger_boards_stay_off_the_ground_and_lose_their_points_to_no_edge():
    scene = Scene()
    walk = Walk(2, 60.0, scene.ground_z, board_m=(1.0, 0.8))
    poses = walk.poses(np.arange(0.0, 60.0, 0.1))
    assert poses.board_m == (1.0, 0.8)
    assert (poses.apex + 1.0 * poses.edge_left + 0.8 * poses.edge_right)[:, 2].min() > scene.ground_z
    lidar = Lidar(SENSORS["hdl64"], scene, walk, sector_deg=60.0, noise_m=0.0, seed=1)
    sweep, label = lidar.labelled_sweep(0, 3.0, 0)
    on = label == BOARD
    at = walk.poses(3.0 + sweep.offset_ns[on] * 1e-9)
    along = ((sweep.xyz[on] - at.apex) * at.edge_left).sum(axis=1)
    assert 0.9 < along.max() < 1.005


def test_values_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="beam_mrad must lie between 0 and 20"):
        Disturbances(beam_mrad=-1.0)
    with pytest.raises(ValueError, match="second_person is one of none, beside, behind"):
        Disturbances(second_person="above")


@pytest.mark.parametrize("plan", WALKS)
def test_every_walk_stays_in_the_field_and_goes_at_its_pace(plan):
    poses = Walk(7, 90.0, -1.85, plan=plan).poses(np.arange(0.0, 90.0, 0.05))
    speed = np.linalg.norm(np.diff(poses.apex[:, :2], axis=0), axis=1) / 0.05
    usual, fastest = {
        "rows": (0.3, 2.5),
        "field": (0.6, 1.7),
        "cover": (0.8, 1.5),
        "yard": (0.4, 1.5),
        "slow": (0.1, 0.35),
        "still": (0.0, 0.01),
    }[plan]
    assert speed.max() < fastest
    assert np.median(speed) >= usual
    assert poses.apex[:, 0].min() > 2.9
    assert poses.apex[:, 0].max() < 32.5
    assert np.abs(poses.apex[:, 1]).max() < 5.5


def test_the_walk_of_the_study_covers_the_field_and_rolls_by_3_5_degrees():
    poses = [Walk(seed, 120.0, -1.85, plan="field").poses(np.arange(0.0, 120.0, 0.2)) for seed in range(12)]
    apex = np.concatenate([pose.apex for pose in poses])
    assert apex[:, 0].min() < 5.5
    assert apex[:, 0].max() > 30.0
    assert 15.0 < np.median(apex[:, 0]) < 22.0
    roll = np.concatenate(
        [np.degrees(np.arctan2(-p.edge_left[:, 2], np.hypot(*p.edge_left[:, :2].T))) for p in poses]
    )
    assert roll.mean() == pytest.approx(45.0, abs=0.5)
    assert roll.std() == pytest.approx(3.5, abs=0.4)


def test_lasers_that_point_aside_keep_their_column_s_time():
    _, sweeps = scanned(sensor="vlp32c")
    sweep, _ = sweeps[3]
    azimuth = np.degrees(np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]).astype(float))
    aside = azimuth - (55.0 - 3600.0 * sweep.offset_ns * 1e-9)
    np.testing.assert_allclose(aside, np.array(SENSORS["vlp32c"].azimuths_deg)[sweep.ring], atol=2e-3)


def test_a_walk_that_covers_the_field_comes_to_its_corners():
    apex = Walk(3, 230.0, -1.85, plan="cover").poses(np.arange(0.0, 230.0, 0.1)).apex
    for x, y in ((4.0, 4.7), (4.0, -4.7), (28.0, 5.0), (28.0, -5.0), (15.0, 0.0)):
        assert np.hypot(apex[:, 0] - x, apex[:, 1] - y).min() < 1.5
