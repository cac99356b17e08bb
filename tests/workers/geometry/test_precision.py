"""Projections over the whole box of the default bounds."""

import cv2
import numpy as np
import pytest

from workers.geometry.models import INTRINSICS, MODELS
from workers.geometry.projection import project

SIZE = np.array([1920.0, 1208.0])
LENSES, POINTS = 200, 60


def draw(model, rng):
    """A lens from anywhere in the `image-size` bounds, and points that it might see."""
    f_x, f_y = SIZE[0] * rng.uniform(0.2, 3.0, 2)
    bent = rng.uniform(-1.0, 1.0, len(INTRINSICS[model]) - 4)
    if model == "brown_conrady":
        bent[0] *= 0.1
    theta = np.arctan(rng.uniform(0.0, 1.2, POINTS) * SIZE[0] / f_x)
    phi = rng.uniform(0.0, 2.0 * np.pi, POINTS)
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return np.array([f_x, f_y, *rng.uniform(0.0, SIZE), *bent]), rays * rng.uniform(1.0, 30.0, (POINTS, 1))


@pytest.mark.parametrize("model", MODELS)
def test_double_precision_is_opencvs_over_the_whole_bounds(model):
    rng = np.random.default_rng(MODELS.index(model))
    none, compared = np.zeros(3), 0
    for _ in range(LENSES):
        lens, points = draw(model, rng)
        if model == "brown_conrady":
            lens[4] = 0.0  # OpenCV knows no skew
        pixels, violation = project(model, lens, points)
        K = np.array([[lens[0], 0.0, lens[2]], [0.0, lens[1], lens[3]], [0.0, 0.0, 1.0]])
        if model == "rational_polynomial":
            theirs = cv2.projectPoints(points, none, none, K, lens[4:])[0]
        elif model == "kannala_brandt":
            theirs = cv2.fisheye.projectPoints(points[:, None], none, none, K, lens[4:])[0]
        else:
            theirs = cv2.projectPoints(points, none, none, K, lens[5:] if model == "brown_conrady" else None)[0]
        good = violation == 0.0
        compared += int(good.sum())
        np.testing.assert_allclose(pixels[good], theirs.reshape(-1, 2)[good], atol=1e-6, rtol=1e-12)
    assert compared > LENSES * POINTS / 4
