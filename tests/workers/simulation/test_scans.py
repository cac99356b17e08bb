"""What a sensor sees of a walk: points on their rings and surfaces, and each flaw and disturbance by its figure."""

from functools import cache

import numpy as np
import pytest

from apexcal.documents.simulation import Disturbances
from tests.support.scenes.flawed_lidar import Flaws, Mount
from tests.support.scenes.held_board import BoardHold
from tests.workers.simulation.scans import azimuths_deg, elevations_deg, ranges, scanned
from workers.simulation.lidar import BOARD, BOX, GROUND, PERSON, POLE, SECOND_PERSON, SPECKLE, WALL
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


@pytest.mark.parametrize("mount", [Mount(8.0, -5.0), Mount(180.0, 3.0), Mount(-20.0, 0.0, -70.0)])
def test_a_tilted_sensor_sees_the_same_world(mount):
    scan = scanned(mount=mount)
    np.testing.assert_allclose(elevations_deg(scan.xyz), np.linspace(-15, 15, 16)[scan.ring], atol=1e-4)
    np.testing.assert_allclose((scan.xyz[scan.label == WALL] @ mount.rotation().T)[:, 0], Scene().wall_x, atol=0.01)
    plane = beside_board(scan)[2]
    assert len(plane) > 50 and np.abs(plane).max() < 0.004


def farther(scan):
    """Metres by which each return is farther than that of a sensor without flaws."""
    return ranges(scan.xyz) - ranges(plain().xyz)


def count(scan, *labels):
    return np.isin(scan.label, labels).sum()


def share(scan, label):
    """Returns of a surface beside those of a sensor without flaws."""
    return count(scan, label) / count(plain(), label)


def apart_m(scan):
    """How far the second person is from the first, at most and at least."""
    poses = scan.walk.poses(np.array(MINUTE_S))
    return np.linalg.norm(poses.second.body - poses.body, axis=1)


def ring_means(scan):
    met = [ring for ring in range(16) if (plain().ring == ring).sum() > 20]
    return [farther(scan)[plain().ring == ring].mean() for ring in met]


def steps_deg(scan):
    first = scan.sweeps[0]
    return np.diff(np.sort(azimuths_deg(first.xyz[first.ring == 0].astype(float))))


def off_slant(scan):
    """Metres by which returns of the board are farther than one over the cosine of their incidence says, less one."""
    on = plain().label == BOARD
    left, right = (each[on] for each in plain().joined("edge_left", "edge_right"))
    cosine = np.abs((np.cross(left, right) * plain().xyz[on]).sum(axis=1)) / ranges(plain().xyz[on])
    return farther(scan)[on] - (1.0 / cosine - 1.0)


def in_box(scan):
    """Metres by which a box's points lie inside of it."""
    x, y, z = (scan.xyz[scan.label == BOX] - (20.0, 0.0, Scene().ground_z)).T
    c, s = np.cos(0.3), np.sin(0.3)
    return np.stack([2.0 - np.abs(c * x + s * y), 0.9 - np.abs(c * y - s * x), 1.6 - z, z - 0.2]).min(axis=0)


BOXES = Scene(boxes=np.array([[20.0, 0.0, 0.3, 2.0, 0.9, 0.2, 1.6]]))
DENSE = {"sensor": "os1-128"}
# What the sensor or the scene has, what is measured, and within what it lies.
FIGURES = {
    "rings off by a constant": ({"flaws": Flaws(ring_bias_m=0.02)}, lambda s: np.std(ring_means(s)), 0.008, 0.04),
    "lasers decoded by the table": (
        {"flaws": Flaws(ring_angle_deg=0.1)},
        lambda s: np.abs(s.xyz[s.label != BOARD][:, 2].min() - plain().xyz[plain().label != BOARD][:, 2].min()),
        *(0.01, 0.2),
    ),
    "dark is farther": (
        {"flaws": Flaws(intensity_m=0.02)}, lambda s: farther(s)[s.label == PERSON].mean(), 0.0058, 0.0098
    ),
    "dark is lost": ({"flaws": Flaws(lost_share=0.5)}, lambda s: share(s, PERSON), 0.51, 0.71),
    "bright is not lost": ({"flaws": Flaws(lost_share=0.5)}, lambda s: share(s, BOARD), 0.9, 1.0),
    "slanted is farther": ({"flaws": Flaws(incidence_m=1.0)}, lambda s: np.abs(off_slant(s)).max(), 0.0, 0.003),
    "a surface needs its share of the beam": (
        {"disturbances": Disturbances(beam_mrad=6.0), "flaws": Flaws(mixing_m=0.01, least_share=0.5)},
        lambda s: count(s, BOARD) / count(scanned(s.disturbances, flaws=Flaws(mixing_m=0.01)), BOARD),
        *(0.1, 0.9),
    ),
    "a motor wavers": ({"flaws": Flaws(wander_deg=0.1)}, lambda s: np.ptp(steps_deg(s)), 0.001, 0.01),
    "an encoder jitters": ({"flaws": Flaws(jitter_mrad=0.2)}, lambda s: steps_deg(s).std(), 0.01, 0.03),
    "a seam": (
        {"mount": Mount(seam_deg=10.0)}, lambda s: azimuths_deg(s.xyz)[np.argmin(s.offset_ns)], 9.0, 10.01
    ),
    "noise": ({"noise_m": 0.02}, lambda s: farther(s).std(), 0.019, 0.021),
    "returns are lost": (
        {"disturbances": Disturbances(dropouts=0.2)}, lambda s: len(s.label) / len(plain().label), 0.79, 0.81
    ),
    "specks": (
        {"disturbances": Disturbances(speckle=0.05)}, lambda s: count(s, SPECKLE) / (0.05 * 4 * 599 * 16), 0.85, 1.15
    ),
    "specks hide what is behind": ({"disturbances": Disturbances(speckle=0.05)}, lambda s: share(s, WALL), 0.9, 0.97),
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
    "hands hide some of the board": (
        DENSE | {"hold": BoardHold(hand_m=0.06)}, lambda s: count(s, BOARD) / count(plain(**DENSE), BOARD), 0.7, 0.999
    ),
    "a coat": (
        DENSE | {"hold": BoardHold(torso_m=0.22, body_behind_m=0.3)},
        lambda s: count(s, PERSON) / count(scanned(hold=BoardHold(torso_m=0.13, body_behind_m=0.3), **DENSE), PERSON),
        *(1.1, 3.0),
    ),
    "a box has its faces": ({"scene": BOXES}, lambda s: np.abs(in_box(s)).max() + 1.0 / count(s, BOX), 0.0, 0.01),
}  # fmt: skip


@pytest.mark.parametrize("name", FIGURES)
def test_a_flaw_or_disturbance_does_what_it_says(name):
    setting, measure, low, high = FIGURES[name]
    assert low <= measure(scanned(**setting)) <= high


def test_a_sensor_rolls_first_and_looks_down_after_that():
    # Its left side is up, and then ahead.
    np.testing.assert_allclose(Mount(90.0, 90.0).rotation() @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-12)
