import numpy as np
import pytest

from workers.simulation.lidar import SENSORS, Lidar, with_rings
from workers.simulation.scene import Scene
from workers.simulation.walker import BOARD_EDGES_M, Walk


@pytest.fixture(scope="module")
def quiet():
    scene = Scene()
    return Lidar(SENSORS["vlp16"], scene, Walk(4, 10.0, scene.ground_z), sector_deg=45.0, noise_m=0.0, seed=4)


def test_points_lie_on_their_ring_and_are_timed_by_their_azimuth(quiet):
    sweep = quiet.sweep(0, 2.0, 123)
    xyz = sweep.xyz.astype(float)
    elevation = np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    np.testing.assert_allclose(elevation, np.linspace(-15, 15, 16)[sweep.ring], atol=1e-4)
    azimuth = np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0]))
    np.testing.assert_allclose(azimuth, 45.0 - 3600.0 * sweep.offset_ns * 1e-9, atol=1e-3)
    assert sweep.stamp_ns == 123
    assert np.abs(azimuth).max() <= 45.0
    one_ring = np.sort(azimuth[sweep.ring == 0])
    np.testing.assert_allclose(np.diff(one_ring), 0.2, atol=1e-3)


def test_nothing_lies_under_the_ground_or_behind_the_wall(quiet):
    xyz = quiet.sweep(1, 3.0, 0).xyz
    assert xyz[:, 2].min() > Scene().ground_z - 0.01
    assert xyz[:, 0].max() < Scene().wall_x + 0.01
    ground = xyz[np.abs(xyz[:, 2] - Scene().ground_z) < 0.01]
    assert len(ground) > 500


def test_bright_points_lie_on_the_board(quiet):
    for index in range(5):
        start_s = 1.5 * index
        sweep = quiet.sweep(index, start_s, 0)
        board = sweep.intensity > 140.0
        assert board.sum() > 25
        poses = quiet._walk.poses(start_s + sweep.offset_ns[board] * 1e-9)
        from_apex = sweep.xyz[board] - poses.apex
        across = (from_apex * np.cross(poses.edge_left, poses.edge_right)).sum(axis=1)
        assert np.abs(across).max() < 0.003  # range is reported in steps of 2 mm
        for edge, length in zip((poses.edge_left, poses.edge_right), BOARD_EDGES_M, strict=True):
            along = (from_apex * edge).sum(axis=1)
            assert along.min() > -0.005
            assert along.max() < length + 0.005


def test_the_walker_moves_during_a_sweep(quiet):
    """The same board seen by a sensor of endless speed would not be where its points are."""
    sweep = quiet.sweep(0, 2.0, 0)
    board = sweep.intensity > 140.0
    first, last = quiet._walk.poses(2.0 + sweep.offset_ns[board][[0, -1]] * 1e-9).apex
    assert np.linalg.norm(first - last) > 1e-4
    assert np.ptp(sweep.offset_ns[board]) > 1_000_000


def test_noise_is_that_of_the_setting():
    scene = Scene()
    walk = Walk(4, 10.0, scene.ground_z)
    sensor = SENSORS["vlp16"]
    noisy = Lidar(sensor, scene, walk, sector_deg=45.0, noise_m=0.02, seed=4).sweep(0, 2.0, 0)
    quiet = Lidar(sensor, scene, walk, sector_deg=45.0, noise_m=0.0, seed=4).sweep(0, 2.0, 0)
    assert len(noisy.xyz) == len(quiet.xyz)
    difference = np.linalg.norm(noisy.xyz, axis=1) - np.linalg.norm(quiet.xyz, axis=1)
    assert difference.std() == pytest.approx(0.02, rel=0.05)
    assert abs(difference.mean()) < 0.002


def test_other_sensors_and_ring_counts():
    scene = Scene()
    walk = Walk(4, 5.0, scene.ground_z)
    for sensor in (SENSORS["hdl32"], SENSORS["os1-64"], with_rings(SENSORS["vlp16"], 40)):
        sweep = Lidar(sensor, scene, walk, sector_deg=30.0, noise_m=0.0, seed=1).sweep(0, 1.0, 0)
        assert sweep.ring.max() < len(sensor.elevations_deg)
        elevation = np.degrees(np.arctan2(sweep.xyz[:, 2], np.hypot(sweep.xyz[:, 0], sweep.xyz[:, 1])))
        np.testing.assert_allclose(elevation, np.array(sensor.elevations_deg)[sweep.ring], atol=1e-4)
