"""Fresh random rigs: a lens that could be, a mount, a walk over the paper's field, and marks with noise."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from apexcal.geometry.se3 import SE3, to_document
from workers.geometry.models import ModelName
from workers.geometry.projection import fold_angle, image_diagonal_px, project
from workers.solver.problem import FitProblem, fit_problem

Floats = NDArray[np.float64]
PAIRS = 222
IMAGE_SIZES = ((640, 480), (1280, 960), (1920, 1080), (1920, 1208))
NOMINAL = SE3("camera", "velodyne", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3))
# The search minimises the mean distance and no pair is left out: what the paper does.
PLAIN: dict[str, Any] = {"loss": "mean", "outliers": "keep"}
# In image widths: the last are true fisheyes, whose polynomial shows only where marks lie far off the axis.
FOCAL: dict[ModelName, tuple[float, float]] = {
    "pinhole": (0.35, 0.9), "brown_conrady": (0.35, 0.9), "kannala_brandt": (0.25, 0.5),
}  # fmt: skip
# (low, high) of what lenses have; all far inside the default bounds of +-1.
DISTORTION: dict[ModelName, tuple[tuple[float, float], ...]] = {
    "pinhole": (),
    "brown_conrady": (
        (-0.02, 0.02), (-0.35, 0.15), (-0.1, 0.15), (-0.003, 0.003), (-0.003, 0.003), (-0.05, 0.05),
    ),
    "kannala_brandt": ((-0.1, 0.1), (-0.03, 0.03), (-0.01, 0.01), (-0.003, 0.003)),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Rig:
    """Points (N, 3) m in the LiDAR's frame, marks (N, 2) px, and the parameters (D,) that made them."""

    model: ModelName
    image_size: tuple[int, int]
    points: Floats
    marks: Floats
    truth: Floats

    def problem(self, marks: Floats | None = None, **request: Any) -> FitProblem:
        """The fit of these pairs inside the default bounds; `request` as in `fit_request`."""
        document = {"model": self.model, "image_size": self.image_size, "nominal": to_document(NOMINAL), **request}
        return fit_problem(fit_request(**document), self.points, self.marks if marks is None else marks)


def algorithm_2(problem: FitProblem) -> FitProblem:
    """The same fit by the paper's Algorithm 2 alone: no slot is polished, and none need agree."""
    return replace(problem, schedule=replace(problem.schedule, agreeing=0))


def draw_rig(model: ModelName, rng: np.random.Generator, any_mount: bool = False) -> Rig:
    """A rig with its mount within 20 degrees a axis of the nominal one, or turned to anywhere.

    The field of 10 x 30 m begins 2 m before the camera and lies where it looks, so that every mount sees it; of the
    vertices walked there those count that fall into the image.
    """
    while True:
        size = IMAGE_SIZES[rng.integers(len(IMAGE_SIZES))]
        lens = _draw_lens(model, size, rng)
        near = rotation_from_vector(np.radians(rng.uniform(-20.0, 20.0, 3)))
        turn = _uniform_rotation(rng) if any_mount else near
        R, t = turn @ FORWARD_LIDAR_TO_OPTICAL, rng.uniform(-0.6, 0.6, 3)
        field = rng.uniform((2.0, -5.0, -1.5), (32.0, 5.0, 1.5), (20 * PAIRS, 3)) @ FORWARD_LIDAR_TO_OPTICAL.T
        points = (field - t) @ R
        pixels, seen = in_image(model, lens, size, points @ R.T + t)
        seen = seen[:PAIRS]
        if len(seen) < PAIRS:
            continue
        marks = pixels[seen] + rng.normal(size=(PAIRS, 2))
        return Rig(model, size, points[seen], marks, np.concatenate([vector_from_rotation(turn), t, lens]))


def in_image(
    model: ModelName, lens: Floats, size: tuple[int, int], optical: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Pixels (N, 2) of points (N, 3) in the optical frame, and the indices of those that the image shows."""
    pixels, violation = project(model, lens, optical)
    inside = (pixels >= 0.0).all(axis=1) & (pixels <= np.array(size) - 1.0).all(axis=1)
    return pixels, np.flatnonzero((violation == 0.0) & inside)


def with_outliers(rig: Rig, share: float, rng: np.random.Generator) -> Floats:
    """Marks (N, 2) of which a share lies anywhere in the image."""
    bad = rng.choice(len(rig.marks), round(share * len(rig.marks)), replace=False)
    marks = rig.marks.copy()
    marks[bad] = rng.uniform((0.0, 0.0), np.array(rig.image_size) - 1.0, (len(bad), 2))
    return marks


def _draw_lens(model: ModelName, size: tuple[int, int], rng: np.random.Generator) -> Floats:
    while True:
        f_x = size[0] * rng.uniform(*FOCAL[model])
        lens = np.array(
            [f_x, f_x * rng.uniform(0.98, 1.02), *(0.5 * np.array(size) + 0.02 * size[0] * rng.normal(size=2))]
            + [rng.uniform(low, high) for low, high in DISTORTION[model]]
        )
        if _images_its_corners(model, lens, size):
            return lens


def _images_its_corners(model: ModelName, lens: Floats, size: tuple[int, int]) -> bool:
    # A lens whose distortion folds inside its own image could not be: the fold must lie past every corner.
    angle = fold_angle(model, lens)
    if model == "pinhole" or (model == "brown_conrady" and angle > np.radians(89.0)):
        return True
    plain = lens.copy()
    plain[:4] = 1.0, 1.0, 0.0, 0.0
    if model == "brown_conrady":
        plain[[4, 7, 8]] = 0.0
    angle *= 1.0 - 1e-9
    image, _ = project(model, plain, np.array([[np.sin(angle), 0.0, np.cos(angle)]]))
    return bool(image[0, 0] * min(lens[:2]) > 1.05 * (0.5 * image_diagonal_px(size) + 0.06 * size[0]))


def _uniform_rotation(rng: np.random.Generator) -> Floats:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0.0 else -q
