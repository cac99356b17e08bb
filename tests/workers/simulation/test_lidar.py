"""Points lie on their rings and surfaces, at the times that their azimuths say."""

import numpy as np
import pytest

from tests.workers.simulation.scans import azimuths_deg, elevations_deg, ranges, scanned
from workers.simulation.flaws import Mount
from workers.simulation.lidar import BOARD, GROUND, PERSON, POLE, SENSORS, WALL, SimulatedLidar, with_rings
from workers.simulation.scene import Scene
from workers.simulation.walker import BOARD_EDGES_M, Walk

MINUTE_S = np.arange(0.5, 59.0, 2.5)


def test_points_lie_on_their_ring_and_are_timed_by_their_azimuth():
    scan = scanned(starts_s=[2.0])
    np.testing.assert_allclose(elevations_deg(scan.xyz), np.linspace(-15, 15, 16)[scan.ring], atol=1e-4)
    azimuth = azimuths_deg(scan.xyz)
    np.testing.assert_allclose(azimuth, 60.0 - 3600.0 * scan.offset_ns * 1e-9, atol=1e-3)
    assert np.abs(azimuth).max() <= 60.0
    np.testing.assert_allclose(np.diff(np.sort(azimuth[scan.ring == 0])), 0.2, atol=1e-3)


def test_labels_say_what_a_point_lies_on():
    scan = scanned(plan="field", starts_s=MINUTE_S)
    assert set(scan.label.tolist()) <= {GROUND, WALL, POLE, BOARD, PERSON}
    np.testing.assert_allclose(scan.xyz[scan.label == GROUND][:, 2], Scene().ground_z, atol=0.005)
    np.testing.assert_allclose(scan.xyz[scan.label == WALL][:, 0], Scene().wall_x, atol=0.005)
    body = scan.joined("body")
    assert np.linalg.norm(scan.xyz[:, :2] - body, axis=1)[scan.label == PERSON].max() < 0.2
    on = scan.label == BOARD
    apex, left, right = (field[on] for field in scan.joined("apex", "edge_left", "edge_right"))
    assert np.count_nonzero(on) > 150
    from_apex = scan.xyz[on] - apex
    assert np.abs((from_apex * np.cross(left, right)).sum(axis=1)).max() < 0.003  # ranges come in steps of 2 mm
    for edge, length in ((left, BOARD_EDGES_M[0]), (right, BOARD_EDGES_M[1])):
        along = (from_apex * edge).sum(axis=1)
        assert -0.005 < along.min() < along.max() < length + 0.005


def test_the_walker_moves_during_a_sweep():
    """The same board seen by a sensor of endless speed would not be where its points are."""
    scan = scanned(starts_s=[1.0])
    on = scan.label == BOARD
    first, *_, last = scan.joined("apex")[on]
    assert np.linalg.norm(first - last) > 1e-4
    assert np.ptp(scan.offset_ns[on]) > 1_000_000


def test_noise_is_that_of_the_setting():
    walk = Walk(4, 10.0, Scene().ground_z)
    noisy, quiet = (
        SimulatedLidar(SENSORS["vlp16"], Scene(), walk, sector_deg=45.0, noise_m=noise_m, seed=4).sweep(0, 2.0, 0)
        for noise_m in (0.02, 0.0)
    )
    assert len(noisy.xyz) == len(quiet.xyz)
    off_m = ranges(noisy.xyz) - ranges(quiet.xyz)
    assert off_m.std() == pytest.approx(0.02, rel=0.05)
    assert abs(off_m.mean()) < 0.002


def test_other_sensors_and_ring_counts():
    walk = Walk(4, 5.0, Scene().ground_z)
    for sensor in (SENSORS["hdl32"], SENSORS["os1-64"], with_rings(SENSORS["vlp16"], 40)):
        sweep = SimulatedLidar(sensor, Scene(), walk, sector_deg=30.0, noise_m=0.0, seed=1).sweep(0, 1.0, 0)
        assert sweep.ring.max() < len(sensor.elevations_deg)
        expected = np.array(sensor.elevations_deg)[sweep.ring]
        np.testing.assert_allclose(elevations_deg(sweep.xyz.astype(float)), expected, atol=1e-3)


def test_lasers_that_point_aside_keep_their_column_s_time():
    scan = scanned(sensor="vlp32c", starts_s=[8.0])
    aside = azimuths_deg(scan.xyz) - (60.0 - 3600.0 * scan.offset_ns * 1e-9)
    np.testing.assert_allclose(aside, np.array(SENSORS["vlp32c"].azimuths_deg)[scan.ring], atol=2e-3)


def test_rings_that_fire_less_often_have_wider_steps():
    scan = scanned(sensor="mixed128", mount=Mount(seam_deg=90.0), starts_s=[1.0])
    for ring, step in ((40, 0.1), (20, 0.2)):
        apart = np.diff(np.sort(azimuths_deg(scan.xyz[(scan.ring == ring) & (scan.label != 0)])))
        assert np.median(apart) == pytest.approx(step, abs=1e-3)
