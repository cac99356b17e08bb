"""What a sensor sees of a walk: points on their rings and surfaces, and each disturbance by its figure."""

from functools import cache

import numpy as np
import pytest

from apexcal.documents.simulation import Disturbances
from tests.support.scenes.flawed_lidar import Mount
from tests.workers.simulation.scans import azimuths_deg, elevations_deg, ranges, scanned
from workers.simulation.beams import BOARD, GROUND, PERSON, POLE, SECOND_PERSON, SPECKLE, WALL
from workers.simulation.scene import Scene
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import BOARD_EDGES_M

MINUTE_S = tuple(np.arange(0.5, 59.0, 2.5))
plain = cache(scanned)


def beside_board(scan):
    """Metres of board points along both edges and off their plane."""
    on = scan.label == BOARD
    apex, left, right = (
        scan.lidar.in_sensor_frame(each[on]) for each in scan.joined("apex", "edge_left", "edge_right")
    )
    from_apex = scan.xyz[on] - apex
    return [(from_apex * axis).sum(axis=1) for axis in (left, right, np.cross(left, right))]


def test_points_lie_on_their_ring_and_are_timed_by_their_azimuth():
    scan = scanned(starts_s=[2.0])
    np.testing.assert_allclose(elevations_deg(scan.xyz), np.linspace(-15, 15, 16)[scan.ring], atol=1e-4)
    azimuth = azimuths_deg(scan.xyz)
    np.testing.assert_allclose(azimuth, 60.0 - 3600.0 * scan.offset_ns * 1e-9, atol=1e-3)
    assert np.abs(azimuth).max() <= 60.0
    np.testing.assert_allclose(np.diff(np.sort(azimuth[scan.ring == 0])), 0.2, atol=1e-3)
    aside = scanned(sensor="vlp32c", starts_s=[8.0])
    off = azimuths_deg(aside.xyz) - (60.0 - 3600.0 * aside.offset_ns * 1e-9)
    np.testing.assert_allclose(off, np.array(SENSORS["vlp32c"].azimuths_deg)[aside.ring], atol=2e-3)


def test_labels_say_what_a_point_lies_on():
    scan = scanned(plan="field", starts_s=MINUTE_S)
    assert set(scan.label.tolist()) <= {GROUND, WALL, POLE, BOARD, PERSON}
    np.testing.assert_allclose(scan.xyz[scan.label == GROUND][:, 2], Scene().ground_z, atol=0.005)
    np.testing.assert_allclose(scan.xyz[scan.label == WALL][:, 0], Scene().wall_x, atol=0.005)
    assert np.linalg.norm(scan.xyz[:, :2] - scan.joined("body"), axis=1)[scan.label == PERSON].max() < 0.2
    *along, plane = beside_board(scan)
    assert len(plane) > 150 and np.abs(plane).max() < 0.003  # ranges come in steps of 2 mm
    for distance, length in zip(along, BOARD_EDGES_M, strict=True):
        assert -0.005 < distance.min() < distance.max() < length + 0.005


def count(scan, *labels):
    return np.isin(scan.label, labels).sum()


def apart_m(scan):
    """How far the second person is from the first, at most and at least."""
    poses = scan.walk.poses(np.array(MINUTE_S))
    return np.linalg.norm(poses.second.body - poses.body, axis=1)


# What the sensor or the scene has, what is measured, and within what it lies.
FIGURES = {
    "a seam": (
        {"mount": Mount(seam_deg=10.0)}, lambda s: azimuths_deg(s.xyz)[np.argmin(s.offset_ns)], 9.0, 10.01
    ),
    "noise": ({"noise_m": 0.02}, lambda s: (ranges(s.xyz) - ranges(plain().xyz)).std(), 0.019, 0.021),
    "returns are lost": (
        {"disturbances": Disturbances(dropouts=0.2)}, lambda s: len(s.label) / len(plain().label), 0.79, 0.81
    ),
    "specks": (
        {"disturbances": Disturbances(speckle=0.05)}, lambda s: count(s, SPECKLE) / (0.05 * 4 * 599 * 16), 0.85, 1.15
    ),
    "a second person beside": (
        {"disturbances": Disturbances(second_person="beside"), "plan": "field"},
        *(lambda s: apart_m(s).min(), 0.35, 1.4),
    ),
    "a second person is seen": (
        {"disturbances": Disturbances(second_person="behind"), "plan": "field", "starts_s": MINUTE_S},
        *(lambda s: count(s, SECOND_PERSON), len(MINUTE_S), 10_000),
    ),
    "a taller walker": (
        {"disturbances": Disturbances(walker_height_m=2.0)},
        lambda s: s.joined("apex")[:, 2].max() - plain().joined("apex")[:, 2].max(),
        *(0.1, 0.6),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_a_disturbance_does_what_it_says(name):
    setting, measure, low, high = FIGURES[name]
    assert low <= measure(scanned(**setting)) <= high
