"""What a sensor sees of a walk: points on their rings and surfaces, and each disturbance by its figure."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from apexcal.documents.simulation import Disturbances
from tests.support.scenes.flawed_lidar import FlawedLidar
from tests.support.scenes.held_board import HeldWalk
from workers.simulation.beams import BOARD, GROUND, PERSON, POLE, SECOND_PERSON, SPECKLE, WALL
from workers.simulation.scene import Scene
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import BOARD_EDGES_M

MINUTE_S = tuple(np.arange(0.5, 59.0, 2.5))


def scanned(disturbances=None, *, sensor="vlp16", plan="yard", noise_m=0.0, starts_s=(1.0, 4.0, 7.0, 10.0)):
    """What a sensor sees of a walk, with what each point lies on and where board and bodies are."""
    scene = Scene()
    walk = HeldWalk(5, 60.0, scene.ground_z, plan=plan, disturbances=disturbances)
    spoiled = {"noise_m": noise_m, "disturbances": disturbances}
    lidar = FlawedLidar(SENSORS[sensor], scene, walk, sector_deg=60.0, seed=5, **spoiled)
    sweeps, labels, poses = [], [], []
    for index, start_s in enumerate(starts_s):
        sweep, label = lidar.labelled_sweep(index, start_s, 0)
        sweeps.append(sweep)
        labels.append(label)
        poses.append(walk.poses(start_s + sweep.offset_ns * 1e-9))

    def joined(*names):
        """Fields of the poses at each point's time, all sweeps as one."""
        fields = (np.concatenate([getattr(one, name) for one in poses]) for name in names)
        return next(fields) if len(names) == 1 else fields

    return SimpleNamespace(
        walk=walk,
        lidar=lidar,
        xyz=np.concatenate([sweep.xyz for sweep in sweeps]).astype(float),
        ring=np.concatenate([sweep.ring for sweep in sweeps]),
        offset_ns=np.concatenate([sweep.offset_ns for sweep in sweeps]),
        label=np.concatenate(labels),
        joined=joined,
    )


def ranges(xyz):
    return np.linalg.norm(xyz, axis=1)


def elevations_deg(xyz):
    return np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))


def azimuths_deg(xyz):
    return np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0]))


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
