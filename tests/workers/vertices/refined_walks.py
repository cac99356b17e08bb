"""Simulated walks for the refined detector's tests, made once per process."""

from functools import cache

import numpy as np

from apexcal.documents.simulation import Disturbances
from tests.support.scenes.flawed_lidar import FlawedLidar
from tests.support.scenes.held_board import HeldWalk
from workers.simulation.beams import BOARD
from workers.simulation.scene import WALKER_REGION, scene_with
from workers.simulation.sensors import SENSORS, with_rings
from workers.simulation.walker import BOARD_EDGES_M
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

REGION = Region.from_document(WALKER_REGION)
SIZE = {"board_width_m": BOARD_EDGES_M[0], "board_height_m": BOARD_EDGES_M[1]}
START_NS = 1_780_000_000_000_000_000


class Recorded:
    """Sweeps of a walk, the apex when each looked at it (S, 3), when that was, and how many rings met the board.

    ``corners`` (S, 4, 3): top, left, right and bottom at that moment.
    """

    def __init__(self, sweeps, apex, moment_ns, rings, corners=None):
        self.corners = corners
        self.sweeps, self.apex, self.moment_ns, self.rings = sweeps, apex, moment_ns, rings
        self.source = Listed(sweeps)
        self.all = range(len(sweeps))


@cache
def walk(
    seed, seconds, *, sensor="vlp16", rings=None, noise_m=0.008, plan="field", disturbances=None, hold=None,
    mount=None, flaws=None,
):  # fmt: skip
    spoiled = disturbances or Disturbances()
    scene = scene_with(spoiled.poles, seed)
    way = walker(seed, seconds, plan=plan, disturbances=spoiled, hold=hold)
    model = with_rings(SENSORS[sensor], rings) if rings else SENSORS[sensor]
    lidar = FlawedLidar(
        model, scene, way, sector_deg=55, noise_m=noise_m, seed=seed, disturbances=spoiled, mount=mount, flaws=flaws
    )
    sweeps, apexes, moments, counts, corners = [], [], [], [], []
    for index in range(round(seconds * 10)):
        start_s = 0.1 * index
        sweep, surface = lidar.labelled_sweep(index, start_s, START_NS + round(start_s * 1e9))
        looked_s = start_s
        for _ in range(4):
            apex = lidar.in_sensor_frame(way.poses(np.array([looked_s])).apex)[0]
            looked_s = start_s + float(lidar.scan_seconds(np.arctan2(apex[1], apex[0])))
        sweeps.append(sweep)
        apexes.append(apex)
        corners.append(corners_at(way, looked_s))
        moments.append(START_NS + round(looked_s * 1e9))
        counts.append(np.unique(sweep.ring[surface == BOARD]).size)
    return Recorded(sweeps, np.array(apexes), np.array(moments), np.array(counts), np.array(corners))


def walker(seed, seconds, *, plan="field", disturbances=None, hold=None):
    """The person of the walk of this seed."""
    spoiled = disturbances or Disturbances()
    return HeldWalk(
        seed, seconds, scene_with(spoiled.poles, seed).ground_z, plan=plan, disturbances=spoiled, hold=hold
    )


def corners_at(way, second):
    """(4, 3) top, left, right and bottom corner at a moment."""
    poses = way.poses(np.array([second]))
    left = poses.board_m[0] * poses.edge_left[0]
    right = poses.board_m[1] * poses.edge_right[0]
    return poses.apex[0] + np.array([0.0 * left, left, right, left + right])


def angles(xyz):
    """Azimuth, elevation (radians) and range of (N, 3)."""
    x, y, z = np.asarray(xyz).reshape(-1, 3).T
    flat = np.hypot(x, y)
    return np.column_stack([np.arctan2(y, x), np.arctan2(z, flat), np.hypot(flat, z)])


def errors(recorded, vertices):
    """(N, 3) degrees, degrees, metres; (N, 3) errors over their stated standard deviations."""
    xyz = np.array([vertex.xyz for vertex in vertices])
    wrong = angles(xyz) - angles(recorded.apex[[vertex.sweep_index for vertex in vertices]])
    stated = np.sqrt([np.diag(vertex.covariance) for vertex in vertices])
    return wrong * np.array([180 / np.pi, 180 / np.pi, 1.0]), wrong / stated
