import numpy as np
import pytest

from apexcal.documents.errors import GeometryError
from workers.geometry.models import INTRINSICS, MODELS
from workers.geometry.projection import fold_angle, project, unproject


def random_lens(model, rng, narrow=1.0):
    """Anywhere in the default bounds of a 1920 x 1208 image, the distortion `narrow` of its box."""
    lens = {name: rng.uniform(-narrow, narrow) for name in INTRINSICS[model]}
    lens |= {"f_x": rng.uniform(384, 5760), "f_y": rng.uniform(384, 5760)}
    lens |= {"c_x": rng.uniform(0, 1919), "c_y": rng.uniform(0, 1207)}
    return lens | ({"skew": rng.uniform(-0.1, 0.1)} if model == "brown_conrady" else {})


def rays_inside(model, lens, rng, count=200):
    reach = 0.9 * min(fold_angle(model, lens), np.radians(175 if model == "kannala_brandt" else 80))
    angle, around = reach * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)], axis=1)


@pytest.mark.parametrize("model", MODELS)
def test_rays_come_back_over_the_whole_bounds(model):
    rng = np.random.default_rng(1)
    residuals = []
    for _ in range(60):
        lens = random_lens(model, rng)
        if model == "brown_conrady":
            # Larger tangential terms fold the image inside the radial fold.
            lens |= {"k3": rng.uniform(-0.01, 0.01), "k4": rng.uniform(-0.01, 0.01)}
        if model == "rational_polynomial":
            lens |= {"p1": rng.uniform(-0.01, 0.01), "p2": rng.uniform(-0.01, 0.01)}
        rays = rays_inside(model, lens, rng)
        pixels, violation = project(model, lens, rays)
        assert not violation.any()
        near = np.hypot(*(pixels - [lens["c_x"], lens["c_y"]]).T) < 4000
        found, residual = unproject(model, lens, pixels[near])
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
        residuals.append(residual)
    # Where tangential terms nearly fold the image themselves Newton may miss, and the residual says so.
    exact = np.concatenate(residuals) < 1e-6
    assert exact.mean() > (0.999 if model in ("brown_conrady", "rational_polynomial") else 0.999999)


@pytest.mark.parametrize("model", MODELS)
def test_rays_are_the_ones_that_were_projected(model):
    rng = np.random.default_rng(2)
    for _ in range(50):
        lens = random_lens(model, rng, narrow=0.02)
        rays = rays_inside(model, lens, rng)
        rays = rays[np.arccos(rays[:, 2]) < 0.7 * fold_angle(model, lens)]
        found, _ = unproject(model, lens, project(model, lens, rays)[0])
        np.testing.assert_allclose(found, rays, atol=1e-9)


def test_where_nothing_is_seen_the_residual_says_so():
    lens = {"f_x": 700, "f_y": 700, "c_x": 640, "c_y": 360, "k1": -0.4}
    edge = fold_angle("brown_conrady", lens)
    farthest = project("brown_conrady", lens, [[np.tan(edge * 0.999999), 0.0, 1.0]])[0][0, 0]
    rays, residual = unproject("brown_conrady", lens, [[farthest - 5.0, 360.0], [farthest + 50.0, 360.0]])
    assert residual[0] < 1e-9
    assert residual[1] == pytest.approx(50.0, abs=0.1)
    assert np.isfinite(rays).all()
    _, residual = unproject("kannala_brandt", {**lens, "k1": -0.1}, [[640.0 + 5000.0, 360.0]])
    assert residual[0] > 1000.0


def test_a_fisheye_sees_behind_its_own_plane():
    lens = {"f_x": 300, "f_y": 300, "c_x": 640, "c_y": 640}
    rays, residual = unproject("kannala_brandt", lens, [[640.0 + 300.0 * np.radians(110), 640.0], [640.0, 640.0]])
    np.testing.assert_allclose(rays[0], [np.sin(np.radians(110)), 0.0, np.cos(np.radians(110))], atol=1e-12)
    np.testing.assert_allclose(rays[1], [0.0, 0.0, 1.0])
    assert residual.max() < 1e-9


def test_bad_pixels_are_named():
    lens = {"f_x": 300, "f_y": 300, "c_x": 640, "c_y": 640}
    with pytest.raises(GeometryError, match="Pixels are finite"):
        unproject("pinhole", lens, [[np.nan, 1.0]])
    with pytest.raises(GeometryError, match="focal length"):
        unproject("pinhole", {**lens, "f_x": 0.0}, [[1.0, 1.0]])
