"""Other mounts, walks and lenses for the rigs of `benchmarks.accuracy`: always what a camera sees of a walk."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from benchmarks.accuracy.rigs import Rig
from workers.geometry.projection import project

Floats = NDArray[np.float64]
CANDIDATES = 6000
"""Vertices walked for every walk; those count that fall into the image."""
FIELD_M = ((2.0, -5.0, -1.5), (32.0, 5.0, 1.5))
"""The paper's field before the camera: forward, left, up."""


def camera_points(rig: Rig) -> Floats:
    """The rig's vertices (N, 3) in the camera's optical frame, metres."""
    R, t = _mount(rig.truth)
    return rig.points @ R.T + t


def remounted(rig: Rig, turn: Floats) -> Rig:
    """The same camera, vertices and marks with the LiDAR turned: `turn` (3, 3) is the camera's from its nominal."""
    seen = camera_points(rig)
    truth = np.concatenate([vector_from_rotation(turn), rig.truth[3:]])
    R, t = _mount(truth)
    return replace(rig, points=(seen - t) @ R, truth=truth)


def random_turn(limit_deg: float, rng: np.random.Generator) -> Floats:
    """A rotation (3, 3) by at most limit_deg, uniform over all such rotations."""
    # About a uniform axis the angle a has the density 1 - cos a.
    angles = np.linspace(0.0, np.radians(limit_deg), 2001)
    weight = angles - np.sin(angles)
    angle = float(np.interp(rng.uniform(0.0, weight[-1]), weight, angles))
    axis = rng.normal(size=3)
    return rotation_from_vector(angle * axis / np.linalg.norm(axis))


def walked(rig: Rig, walk: Floats, pairs: int, rng: np.random.Generator, noise_px: float = 1.0) -> Rig | None:
    """The rig with the first `pairs` vertices of a walk that lie in the image; None where it holds fewer.

    walk (M, 3): metres forward, left and up of the camera.
    """
    R, t = _mount(rig.truth)
    optical = walk @ FORWARD_LIDAR_TO_OPTICAL.T
    pixels, violation = project(rig.model, rig.truth[6:], optical)
    inside = (pixels >= 0.0).all(axis=1) & (pixels <= np.array(rig.image_size) - 1.0).all(axis=1)
    seen = np.flatnonzero((violation == 0.0) & inside)[:pairs]
    if len(seen) < pairs:
        return None
    marks = pixels[seen] + noise_px * rng.normal(size=(pairs, 2))
    return replace(rig, points=(optical[seen] - t) @ R, marks=marks)


def field(rng: np.random.Generator) -> Floats:
    """Vertices (M, 3) anywhere in the paper's field."""
    return rng.uniform(*FIELD_M, (CANDIDATES, 3))


def flat_field(thickness_m: float, rng: np.random.Generator) -> Floats:
    """Vertices (M, 3) all over the field, at one height above or below the camera but for the thickness."""
    walk = field(rng)
    height = rng.choice((-1.0, 1.0)) * rng.uniform(0.3, 1.0)
    walk[:, 2] = height + thickness_m * rng.uniform(-0.5, 0.5, len(walk))
    return walk


def one_line(thickness_m: float, rng: np.random.Generator) -> Floats:
    """Vertices (M, 3) along a straight line that crosses the field slantwise, so far off it as the thickness says."""
    heading = rng.choice((-1.0, 1.0)) * np.radians(rng.uniform(15.0, 60.0))
    middle = np.array(
        [rng.uniform(8.0, 16.0), rng.uniform(-2.0, 2.0), rng.choice((-1.0, 1.0)) * rng.uniform(0.3, 1.0)]
    )
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    walk = middle + rng.uniform(-14.0, 14.0, (CANDIDATES, 1)) * along
    walk += thickness_m * rng.uniform(-0.5, 0.5, walk.shape)
    return walk[walk[:, 0] > 1.0]


def _mount(truth: Floats) -> tuple[Floats, Floats]:
    return rotation_from_vector(truth[:3]) @ FORWARD_LIDAR_TO_OPTICAL, truth[3:6]
