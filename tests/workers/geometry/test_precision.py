"""Both precisions of the kernels over the whole box of the default bounds."""

import cv2
import numpy as np
import pytest
from numba import njit

from workers.geometry.models import INTRINSICS, MODELS
from workers.geometry.projection import project
from workers.geometry.projections.brown_conrady import brown_conrady_fold, brown_conrady_point
from workers.geometry.projections.kannala_brandt import kannala_brandt_fold, kannala_brandt_point
from workers.geometry.projections.pinhole import pinhole_point
from workers.geometry.projections.rational_polynomial import rational_polynomial_fold, rational_polynomial_point

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


@njit(error_model="numpy")
def _single(model_id, points, k, fold, out):
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if model_id == 0:
            out[i] = pinhole_point(x, y, z, k[0], k[1], k[2], k[3])
        elif model_id == 1:
            out[i] = brown_conrady_point(
                x, y, z, k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], fold
            )  # fmt: skip
        elif model_id == 2:
            out[i] = kannala_brandt_point(x, y, z, k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], fold)
        else:
            out[i] = rational_polynomial_point(
                x, y, z, k[0], k[1], k[2], k[3], k[4], k[5], k[6], k[7], k[8], k[9], k[10], k[11], fold
            )  # fmt: skip


@pytest.mark.parametrize("model", MODELS)
def test_single_precision_is_within_a_hundredth_of_a_pixel_inside_the_image(model):
    rng = np.random.default_rng(10 + MODELS.index(model))
    out, compared = np.empty((POINTS, 3), dtype=np.float32), 0
    for _ in range(LENSES):
        lens, points = draw(model, rng)
        fold = np.inf
        if model == "brown_conrady":
            fold = brown_conrady_fold(lens[5], lens[6], lens[9])
        elif model == "kannala_brandt":
            fold = kannala_brandt_fold(*lens[4:])
        elif model == "rational_polynomial":
            fold = rational_polynomial_fold(*lens[[4, 5, 8, 9, 10, 11]])
        pixels, violation = project(model, lens, points)
        _single(MODELS.index(model), points.astype(np.float32), lens.astype(np.float32), np.float32(fold), out)
        # On the fold's very edge either may call it past.
        inside = (violation == 0.0) & (out[:, 2] == 0.0) & ((pixels >= 0.0) & (pixels <= SIZE - 1.0)).all(axis=1)
        compared += int(inside.sum())
        np.testing.assert_allclose(out[inside, :2], pixels[inside], atol=0.01, rtol=0.0)
        assert np.count_nonzero((violation > 0.0) != (out[:, 2] > 0.0)) <= 1
    assert compared > LENSES * POINTS / 10
