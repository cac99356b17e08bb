"""One walk before two cameras of a rig, each calibrated on its own."""

from dataclasses import dataclass

import numpy as np

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from apexcal.geometry.se3 import SE3, to_document
from workers.geometry.projection import project
from workers.solver.narrowing import advance, start
from workers.solver.polish import polish
from workers.solver.problem import fit_problem
from workers.solver.rig_consistency import SolvedCamera
from workers.solver.slot import SlotOutcome
from workers.solver.solution import finished

SIZE = (1280, 960)


@dataclass(frozen=True)
class Mount:
    """A pinhole camera at a turn (degrees, about its own axes) and place (m) from looking forward."""

    name: str
    turn_deg: tuple[float, float, float]
    t: tuple[float, float, float]
    focal_px: float = 600.0

    @property
    def transform(self):
        R = rotation_from_vector(np.radians(self.turn_deg)) @ FORWARD_LIDAR_TO_OPTICAL
        return SE3(self.name, "velodyne", R, np.array(self.t))

    @property
    def lens(self):
        return np.array([self.focal_px, self.focal_px, 639.5, 479.5])


FRONT = Mount("front", (0.0, 8.0, 0.0), (0.1, -0.2, 0.05))
LEFT = Mount("left", (2.0, -9.0, 1.0), (-0.4, -0.15, 0.1), 640.0)


def walked(seed, count=150):
    """Points (N, 3) and their pixels in both cameras, without noise."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((4, -10, -1.5), (25, 10, 1.5), (60 * count, 3))
    pixels = []
    inside = np.ones(len(points), np.bool_)
    for mount in (FRONT, LEFT):
        seen, violation = project("pinhole", mount.lens, mount.transform.apply(points))
        pixels.append(seen)
        inside &= (violation == 0) & (seen > 0).all(axis=1) & (seen < np.array(SIZE) - 1).all(axis=1)
    rows = np.flatnonzero(inside)[:count]
    assert len(rows) == count
    return points[rows], [one[rows] for one in pixels]


def solved(mount, points, pixels, stamps=None, detection=None, **request):
    """The camera as a calibration has it: polished from the truth, and described."""
    nominal = SE3(mount.name, "velodyne", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3))
    document = {"model": "pinhole", "image_size": SIZE, "nominal": to_document(nominal), **request}
    problem = fit_problem(fit_request(**document), points, pixels)
    at = np.concatenate([np.radians(mount.turn_deg), mount.t, mount.lens])
    best = polish(problem, np.clip(at, problem.lower, problem.upper))
    outcome = SlotOutcome(best.mean_px, tuple(best.parameters), 0)
    state = advance(problem, start(problem), [outcome] * problem.schedule.slots)
    columns = dict(zip("xyzuv", np.column_stack([points, pixels]).T.tolist(), strict=True))
    columns["stamp_ns"] = list(range(len(points))) if stamps is None else stamps
    return SolvedCamera(mount.name, problem, finished(problem, state).result, columns, detection)


def rig_of(seed, noise_px=1.0, **request):
    """Both cameras, solved from one walk with fresh noise."""
    rng = np.random.default_rng(seed + 1000)
    points, pixels = walked(seed)
    return [
        solved(mount, points, seen + noise_px * rng.normal(size=seen.shape), **request)
        for mount, seen in zip((FRONT, LEFT), pixels, strict=True)
    ]
