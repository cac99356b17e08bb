"""Each flaw of a sensor does what it says, by itself."""

import numpy as np
import pytest

from apexcal.documents.simulation import Disturbances
from tests.workers.simulation.scans import azimuths_deg, elevations_deg, ranges, scanned
from workers.simulation.flaws import Flaws, Mount
from workers.simulation.lidar import BOARD, PERSON, WALL
from workers.simulation.scene import Scene


@pytest.fixture(scope="module")
def plain():
    return scanned()


def test_rings_are_off_by_a_constant_each(plain):
    off = ranges(scanned(flaws=Flaws(ring_bias_m=0.02)).xyz) - ranges(plain.xyz)
    met = [ring for ring in range(16) if np.count_nonzero(plain.ring == ring) > 20]
    assert len(met) > 8
    assert 0.008 < np.std([off[plain.ring == ring].mean() for ring in met]) < 0.04
    assert max(off[plain.ring == ring].std() for ring in met) < 0.002


def test_lasers_that_point_elsewhere_are_decoded_by_the_table(plain):
    turned = scanned(flaws=Flaws(ring_angle_deg=0.1))
    np.testing.assert_allclose(elevations_deg(turned.xyz), np.linspace(-15, 15, 16)[turned.ring], atol=1e-4)
    lowest = [scan.xyz[scan.label != BOARD][:, 2].min() for scan in (plain, turned)]
    assert abs(lowest[1] - lowest[0]) > 0.01


def test_dark_surfaces_are_farther_and_lost_more_often(plain):
    off = ranges(scanned(flaws=Flaws(intensity_m=0.02)).xyz) - ranges(plain.xyz)
    holed = scanned(flaws=Flaws(lost_share=0.5))
    share = {}
    for surface, brightness in ((PERSON, 28 / 255), (BOARD, 190 / 255)):
        assert off[plain.label == surface].mean() == pytest.approx(0.02 * (0.5 - brightness), abs=0.002)
        share[surface] = np.count_nonzero(holed.label == surface) / np.count_nonzero(plain.label == surface)
    assert share[PERSON] == pytest.approx(1.0 - 0.5 * (1.0 - 2.0 * 28 / 255), abs=0.1)
    assert share[BOARD] > 0.9


def test_a_slanted_board_is_farther_by_what_is_said_at_60_degrees(plain):
    slanted = scanned(flaws=Flaws(incidence_m=1.0))
    on = plain.label == BOARD
    left, right = (field[on] for field in plain.joined("edge_left", "edge_right"))
    cosine = np.abs((np.cross(left, right) * plain.xyz[on]).sum(axis=1)) / ranges(plain.xyz[on])
    off = ranges(slanted.xyz[on]) - ranges(plain.xyz[on])
    np.testing.assert_allclose(off, 1.0 / cosine - 1.0, atol=0.003)


def test_surfaces_close_behind_one_another_mix_at_the_edges():
    between = []
    for flaws in (None, Flaws(mixing_m=0.8)):
        scan = scanned(Disturbances(beam_mrad=4.0), flaws=flaws, sensor="os1-128")
        apex, left, right = scan.joined("apex", "edge_left", "edge_right")
        away = np.cross(left, right)
        away *= np.sign((away * apex).sum(axis=1, keepdims=True))
        depth = ((scan.xyz - apex) * away).sum(axis=1)[ranges(scan.xyz - apex) < 1.2]
        between.append(np.count_nonzero((depth > 0.005) & (depth < 0.05)))
    assert between[1] > between[0] + 5


def test_a_surface_needs_its_share_of_the_beam():
    wide = Disturbances(beam_mrad=6.0)
    counts = [
        np.count_nonzero(scanned(wide, flaws=Flaws(mixing_m=0.01, least_share=least)).label == BOARD)
        for least in (0.0, 0.5)
    ]
    assert counts[1] < 0.9 * counts[0]


def test_a_motor_that_wavers_and_an_encoder_that_jitters(plain):
    def steps(scan):
        sweep = scan.sweeps[0]
        return np.diff(np.sort(azimuths_deg(sweep.xyz[sweep.ring == 0].astype(float))))

    assert np.ptp(steps(plain)) < 1e-3
    assert 0.001 < np.ptp(steps(scanned(flaws=Flaws(wander_deg=0.1)))) < 0.01
    assert 0.01 < steps(scanned(flaws=Flaws(jitter_mrad=0.2))).std() < 0.03


def test_the_seam_cuts_the_sweep_where_it_is_said_to_be():
    scan = scanned(mount=Mount(seam_deg=10.0), starts_s=[1.0])
    azimuth = azimuths_deg(scan.xyz)
    first, last = azimuth[np.argmin(scan.offset_ns)], azimuth[np.argmax(scan.offset_ns)]
    assert 9.0 < first <= 10.01 < last < 11.0
    assert np.abs(azimuth).max() < 60.3
    assert scan.offset_ns.max() > 90_000_000
    np.testing.assert_allclose(scan.lidar.scan_seconds(np.deg2rad([10.0, 0.0, 20.0])), [0.0, 1 / 360, 35 / 360])


@pytest.mark.parametrize("mount", [Mount(8.0, -5.0), Mount(180.0, 3.0), Mount(-20.0, 0.0, -70.0)])
def test_a_tilted_sensor_sees_the_same_world(mount):
    scan = scanned(mount=mount)
    np.testing.assert_allclose(elevations_deg(scan.xyz), np.linspace(-15, 15, 16)[scan.ring], atol=1e-4)
    wall = scan.xyz[scan.label == WALL] @ mount.rotation().T
    np.testing.assert_allclose(wall[:, 0], Scene().wall_x, atol=0.01)
    on = scan.label == BOARD
    apex, left, right = (field[on] for field in scan.joined("apex", "edge_left", "edge_right"))
    plane = (
        (scan.xyz[on] - scan.lidar.in_sensor_frame(apex)) * scan.lidar.in_sensor_frame(np.cross(left, right))
    ).sum(axis=1)
    assert len(plane) > 50 and np.abs(plane).max() < 0.004


def test_a_sensor_rolls_first_and_looks_down_after_that():
    # Its left side is up, and then ahead.
    np.testing.assert_allclose(Mount(90.0, 90.0).rotation() @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-12)
