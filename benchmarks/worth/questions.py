"""What is varied, and over which values: each question is one curve of every method."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.bounds import DEFAULT_ROTATION_RANGE_DEG
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from benchmarks.accuracy.rigs import Rig, draw_rig, in_image, with_outliers
from benchmarks.worth.methods import Case, compare
from benchmarks.worth.mistakes import camera_points, mount_of, other_corner, slipped_run, swapped_neighbours
from workers.geometry.models import DEFAULT_MODELS as MODELS
from workers.geometry.models import ModelName

Floats = NDArray[np.float64]
Draw = Callable[[ModelName, float, np.random.Generator], Case | None]
CHECKS = 300
"""Noiseless vertices over the field on which a calibration is checked, of so many in the paper's field."""
CANDIDATES = 6000


class Question(NamedTuple):
    """One quantity that is varied, the values at which rigs are drawn, and how one is: None if it cannot be."""

    label: str
    values: tuple[float, ...]
    draw: Draw


def _case(rig: Rig, rng: np.random.Generator, **request: Any) -> Case | None:
    """The rig, with the same camera before the paper's field: forward, left and up of it, metres."""
    optical = rng.uniform((2.0, -5.0, -1.5), (32.0, 5.0, 1.5), (CANDIDATES, 3)) @ FORWARD_LIDAR_TO_OPTICAL.T
    pixels, seen = in_image(rig.model, rig.truth[6:], rig.image_size, optical)
    seen = seen[:CHECKS]
    R, t = mount_of(rig.truth)
    check = replace(rig, points=(optical[seen] - t) @ R, marks=pixels[seen])
    return Case(rig, check, request) if len(seen) == CHECKS else None


def _mount(model: ModelName, value: float, rng: np.random.Generator) -> Case | None:
    """The same camera, vertices and marks with the LiDAR turned by at most `value` degrees from the nominal."""
    rig = draw_rig(model, rng)
    truth = np.concatenate([vector_from_rotation(_random_turn(value, rng)), rig.truth[3:]])
    R, t = mount_of(truth)
    return _case(replace(rig, points=(camera_points(rig) - t) @ R, truth=truth), rng, rotation_range_deg=value)


def _random_turn(limit_deg: float, rng: np.random.Generator) -> Floats:
    """A rotation (3, 3) by at most limit_deg, uniform over all such rotations."""
    # About a uniform axis the angle a has the density 1 - cos a.
    angles = np.linspace(0.0, np.radians(limit_deg), 2001)
    weight = angles - np.sin(angles)
    angle = float(np.interp(rng.uniform(0.0, weight[-1]), weight, angles))
    axis = rng.normal(size=3)
    return rotation_from_vector(angle * axis / np.linalg.norm(axis))


def _marked(
    marking: Callable[[Rig, float, np.random.Generator], Floats], reach_deg: float = DEFAULT_ROTATION_RANGE_DEG
) -> Draw:
    def make(model: ModelName, value: float, rng: np.random.Generator) -> Case | None:
        rig = draw_rig(model, rng, any_mount=reach_deg == 180.0)
        try:
            marks = marking(rig, 0.01 * value, rng)
        except ValueError:
            return None
        return _case(replace(rig, marks=marks), rng, loss="saturating", rotation_range_deg=reach_deg)

    return make


_SHARES = (10.0, 20.0, 30.0, 40.0, 50.0)
QUESTIONS: Mapping[str, Question] = {
    "mount": Question("mount known to ± (degrees)", (5.0, 30.0, 45.0, 60.0, 90.0, 120.0, 150.0, 180.0), _mount),
    "outliers_random": Question("wrong marks anywhere (% of 222)", (0.0, *_SHARES, 60.0), _marked(with_outliers)),
    "outliers_any_mount": Question("the same, mount unknown", (0.0, *_SHARES, 60.0), _marked(with_outliers, 180.0)),
    "outliers_corner": Question("another corner of the board (%)", _SHARES, _marked(other_corner)),
    "outliers_swapped": Question("next frames swapped (%)", _SHARES, _marked(swapped_neighbours)),
    "outliers_run": Question("one run slipped by a frame (%)", _SHARES, _marked(slipped_run)),
}

Place = tuple[str, int, int]
"""A question, the index of its value, and the number of the rig there."""


def answer(place: Place, seed: int) -> dict[str, dict[str, float]]:
    """What one fresh rig tells, reproducible from the seed and its place; the models take turns."""
    name, index, number = place
    question = QUESTIONS[name]
    rng = np.random.default_rng((seed, list(QUESTIONS).index(name), index, number))
    case = None
    while case is None:
        case = question.draw(MODELS[number % len(MODELS)], question.values[index], rng)
    return compare(case, int(rng.integers(2**31)))
