"""What a sensor sees of a walk, with what each point lies on and where board and bodies are."""

from types import SimpleNamespace

import numpy as np

from tests.support.scenes.flawed_lidar import FlawedLidar
from tests.support.scenes.held_board import HeldWalk
from workers.simulation.scene import Scene
from workers.simulation.sensors import SENSORS


def scanned(
    disturbances=None,
    *,
    mount=None,
    sensor="vlp16",
    plan="yard",
    noise_m=0.0,
    starts_s=(1.0, 4.0, 7.0, 10.0),
):
    scene = Scene()
    walk = HeldWalk(5, 60.0, scene.ground_z, plan=plan, disturbances=disturbances)
    spoiled = {"noise_m": noise_m, "disturbances": disturbances, "mount": mount}
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
        disturbances=disturbances,
        lidar=lidar,
        sweeps=sweeps,
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
