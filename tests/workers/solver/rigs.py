"""Simulated rigs that a lens could be, with marks of 1 px noise, and the real correspondences."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector, vector_from_rotation
from apexcal.geometry.se3 import SE3, to_document
from tests.support.places import BOARD
from workers.geometry.projection import project
from workers.solver.polish import mean_and_rms, polish
from workers.solver.problem import fit_problem
from workers.solver.residuals import predict, transform_of
from workers.solver.solution import finished

NOMINAL = to_document(SE3("camera_front_optical", "velodyne", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3)))
SIZE = (1280, 960)
# Least squares of all pairs: what many tests compare with.
PLAIN = {"loss": "mean", "outliers": "keep"}
DISTORTION = {
    "pinhole": [],
    "brown_conrady": [0.0, -0.15, 0.03, 0.0005, -0.0005, -0.002],
    "kannala_brandt": [-0.05, 0.01, -0.003, 0.0003],
    "rational_polynomial": [0.4, 0.02, 0.0005, -0.0005, 0.0, 0.6, 0.1, 0.004],
}
REAL = BOARD / "correspondences.csv"


def simulated(model, seed, pairs=222, mount_deg=15.0, noise_px=1.0, **request):
    """(problem, true parameters): a walk over the paper's 10 x 30 m field, kept where the camera sees it."""
    rng = np.random.default_rng(seed)
    focal = rng.uniform(500, 800)
    lens = np.array(
        [focal, focal * rng.uniform(0.98, 1.02), *(np.array(SIZE) / 2 + rng.normal(size=2) * 20)]
        + [term * rng.uniform(0.5, 1.5) for term in DISTORTION[model]]
    )
    R = rotation_from_vector(np.radians(rng.uniform(-mount_deg, mount_deg, 3))) @ FORWARD_LIDAR_TO_OPTICAL
    t = rng.uniform(-0.5, 0.5, 3)
    # The field lies where the camera looks, so that any mount sees it.
    field = rng.uniform((3, -10, -1.5), (30, 10, 1.5), (40 * pairs, 3)) @ FORWARD_LIDAR_TO_OPTICAL.T
    points = (field - t) @ R
    pixels, violation = project(model, lens, points @ R.T + t)
    inside = np.flatnonzero((violation == 0) & (pixels > 0).all(axis=1) & (pixels < np.array(SIZE) - 1).all(axis=1))
    seen = inside[:pairs]
    assert len(seen) == pairs
    marks = pixels[seen] + rng.normal(size=(pairs, 2)) * noise_px
    document = {"model": model, "image_size": SIZE, "nominal": NOMINAL, "seed": seed, **request}
    problem = fit_problem(fit_request(**document), points[seen], marks)
    w = vector_from_rotation(R @ FORWARD_LIDAR_TO_OPTICAL.T)
    return problem, np.concatenate([w, t, lens])


def decentred(problem, truth, terms):
    """The problem with its marks where a fisheye with tangential terms p1, p2 in the plane of theta puts them."""
    x, y, z = transform_of(problem, truth).apply(problem.points).T
    theta, phi = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    around = np.array([np.sin(2 * phi), 2 + np.cos(2 * phi), 2 - np.cos(2 * phi)])
    bent = np.stack([terms @ around[:2], terms @ around[[2, 0]]], axis=1)
    return replace(problem, pixels=problem.pixels + (theta**2)[:, None] * bent * truth[6:8])


def plain(result):
    """A result as it is stored."""
    return json.loads(json.dumps(result.model_dump(mode="json", exclude_unset=True), allow_nan=False))


def finish_plain(problem, state):
    """The result of a search that ended, as it is stored."""
    return plain(finished(problem, state).result)


def best_mean_px(problem, truth):
    """The optimum of the mean distance, by iteratively reweighted least squares from the truth."""
    p = np.array(polish(problem, truth).parameters)
    best = mean_and_rms(problem, p)[0]
    for _ in range(30):
        distances = np.hypot(*(residual_pairs(problem, p).T))
        p = np.array(polish(replace(problem, weights=1 / np.maximum(distances, 1e-3)), p).parameters)
        best = min(best, mean_and_rms(problem, p)[0])
    return best


def residual_pairs(problem, p):

    return predict(problem, p)[0] - problem.pixels


def real_correspondences():
    """Points (80, 3), pixels (80, 2), poses (80,) of the recorded board."""
    if not REAL.exists():
        pytest.skip(f"real correspondences are absent: {REAL.name} is looked for in ../shared/data")
    with REAL.open() as file:
        rows = list(csv.DictReader(file))
    points = np.array([[float(row[name]) for name in "xyz"] for row in rows])
    pixels = np.array([[float(row[name]) for name in "uv"] for row in rows])
    return points, pixels, np.array([int(row["pose"]) for row in rows])


def real_problem(model, **request):
    points, pixels, _ = real_correspondences()
    document = {"model": model, "image_size": [1920, 1208], "nominal": NOMINAL, **request}
    return fit_problem(fit_request(**document), points, pixels)
