"""Other mounts, walks and lenses for the rigs of `benchmarks.accuracy`: always what a camera sees of a walk."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from benchmarks.accuracy.rigs import DISTORTION, IMAGE_SIZES, Rig
from workers.geometry.models import ModelName
from workers.geometry.projection import fold_angle, image_diagonal_px, project

Floats = NDArray[np.float64]
CANDIDATES = 6000
"""Vertices walked for every walk; those count that fall into the image."""
FIELD_M = ((2.0, -5.0, -1.5), (32.0, 5.0, 1.5))
"""The paper's field before the camera: forward, left, up."""
_FOCAL_ROOM = (0.21, 2.9)  # of f_x over the image's width, inside the default bounds


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


def all_round(view_deg: float, rng: np.random.Generator) -> Floats:
    """Vertices (M, 3) at 2 to 20 m in every direction that a camera of that horizontal field of view sees."""
    azimuth = np.radians(0.5 * view_deg) * rng.uniform(-1.0, 1.0, CANDIDATES)
    away = rng.uniform(2.0, 20.0, CANDIDATES)
    return np.stack([away * np.cos(azimuth), away * np.sin(azimuth), rng.uniform(-1.5, 1.5, CANDIDATES)], axis=1)


def camera_with_view(model: ModelName, view_deg: float, rng: np.random.Generator) -> Rig:
    """A rig without pairs: a lens of that horizontal field of view, a mount within 20 degrees a axis of the nominal.

    Raises ValueError where no such lens can be drawn: a pinhole sees no half circle.
    """
    for _ in range(5000):
        size = IMAGE_SIZES[rng.integers(len(IMAGE_SIZES))]
        lens = np.array([1.0, 1.0, 0.0, 0.0, *(rng.uniform(low, high) for low, high in DISTORTION[model])])
        half = np.radians(0.5 * view_deg)
        # Half the image's width shows half the field of view; the fold lies past it.
        edge, violation = project(model, lens, np.array([[np.sin(half), 0.0, np.cos(half)]]))
        if violation[0] > 0.0 or fold_angle(model, lens) < 1.05 * half:
            continue
        f_x = 0.5 * size[0] / edge[0, 0]
        if not _FOCAL_ROOM[0] * size[0] < f_x < _FOCAL_ROOM[1] * size[0]:
            continue
        lens[:2] = f_x, f_x * rng.uniform(0.98, 1.02)
        lens[2:4] = 0.5 * np.array(size) + 0.01 * image_diagonal_px(size) * rng.normal(size=2)
        mount = [*np.radians(rng.uniform(-20.0, 20.0, 3)), *rng.uniform(-0.6, 0.6, 3)]
        return Rig(model, size, np.empty((0, 3)), np.empty((0, 2)), np.concatenate([mount, lens]))
    raise ValueError(f"No {model} lens sees {view_deg} degrees.")


def _mount(truth: Floats) -> tuple[Floats, Floats]:
    return rotation_from_vector(truth[:3]) @ FORWARD_LIDAR_TO_OPTICAL, truth[3:6]
