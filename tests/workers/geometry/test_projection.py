import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit

from apexcal.documents.errors import GeometryError
from workers.geometry.models import MODELS
from workers.geometry.polar_angle import polar_angle
from workers.geometry.projection import distances_px, fold_angle, image_diagonal_px, project, violation_cost_px
from workers.geometry.projections.brown_conrady import brown_conrady_fold
from workers.geometry.projections.kannala_brandt import kannala_brandt_fold
from workers.geometry.projections.rational_polynomial import rational_polynomial_fold
from workers.geometry.projections.table import PROJECTIONS

K = {"f_x": 700.0, "f_y": 710.0, "c_x": 640.0, "c_y": 360.0}


def field(seed=0, count=200, half_angle_deg=75.0):
    rng = np.random.default_rng(seed)
    theta = np.radians(rng.uniform(0, half_angle_deg, count))
    phi = rng.uniform(0, 2 * np.pi, count)
    directions = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return directions * rng.uniform(1, 30, (count, 1))


def test_skew_is_kept_where_opencv_drops_it():
    points = field(half_angle_deg=40)
    lens = {**K, "k1": -0.1, "k3": 0.01}
    straight, _ = project("brown_conrady", lens, points)
    skewed, _ = project("brown_conrady", {**lens, "skew": 0.05}, points)
    b_d = (straight[:, 1] - K["c_y"]) / K["f_y"]
    np.testing.assert_allclose(skewed[:, 0] - straight[:, 0], K["f_x"] * 0.05 * b_d, atol=1e-9)
    np.testing.assert_allclose(skewed[:, 1], straight[:, 1], atol=1e-12)


def test_folds_are_exact_also_where_they_come_and_go_at_once():
    rng = np.random.default_rng(0)
    for k in rng.uniform(-1, 1, (400, 4)) * np.repeat([1.0, 0.1], 200)[:, None]:
        for fold, powers, least in (
            (brown_conrady_fold(*k[:3]), (3, 5, 7), np.inf),
            (kannala_brandt_fold(*k) ** 2, (3, 5, 7, 9), np.pi**2),
        ):
            roots = np.roots([*(k[: len(powers)] * powers)[::-1], 1.0])
            real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
            assert fold == pytest.approx(min(real.min(initial=np.inf), least), rel=1e-7)
    # (1 - x / a)^2 (1 + x / 10) less a hair: two zeros a millionth apart, a third of a grid step from anything round.
    a, hair = 1.2345, 1e-13
    k1, k2, k5 = (-2 / a + 0.1) / 3, (1 / a**2 - 0.2 / a) / 5, 0.1 / a**2 / 7
    assert brown_conrady_fold(k1 - hair, k2, k5) == pytest.approx(a, rel=1e-5)
    assert brown_conrady_fold(k1 + 1e-9, k2, k5) == np.inf
    # Terms that all grow have no fold; without any the cubic's zero is threefold.
    for k in ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.1), (0.1, 0.1, 0.1)):
        assert brown_conrady_fold(*k) == np.inf
    # Past a last term of rounding's size it lies at 90 degrees, less a hair.
    assert np.arctan(brown_conrady_fold(0.1514, 0.9333, -5.6e-16) ** 0.5) == pytest.approx(np.pi / 2)


def test_a_quotient_ends_where_it_stops_growing_or_its_divisor_ends():
    rng = np.random.default_rng(0)
    s = np.poly1d([1, 0])
    for scale in (0.1, 1.0, 5.0):
        for k in rng.uniform(-scale, scale, (60, 6)):
            above, under = np.poly1d([*k[2::-1], 1]), np.poly1d([*k[:2:-1], 1])
            growth = above * under + 2 * s * (above.deriv() * under - above * under.deriv())
            roots = np.concatenate([growth.roots, under.roots])
            real = roots.real[(np.abs(roots.imag) < 1e-8) & (roots.real > 1e-9)]
            fold, least = rational_polynomial_fold(*k), real.min(initial=np.inf)
            assert fold == pytest.approx(least, rel=1e-5) or min(fold, least) > 1e6
    assert rational_polynomial_fold(0.3, 0.0, 0.1, 0.0, 0.0, 0.0) == np.inf
    assert rational_polynomial_fold(0.0, 0.0, 0.0, -0.5, 0.0, 0.0) == pytest.approx(2.0)


@pytest.mark.parametrize("model", MODELS)
def test_forbidden_projections_cost_more_than_the_diagonal_and_grow(model):
    lens = {**K, "k1": -0.3, "k2": 0.0}
    edge = min(fold_angle(model, lens), np.radians(89.99))
    theta = edge + np.radians(np.array([0.5, 5.0, 30.0, 60.0]))
    points = 4.0 * np.stack([np.sin(theta), np.zeros(4), np.cos(theta)], axis=1)
    pixels, violation = project(model, lens, points)
    assert np.isnan(pixels).all()
    cost = violation_cost_px(violation, image_diagonal_px((1280, 720)))
    assert cost[0] >= image_diagonal_px((1280, 720))
    assert (np.diff(cost) > 0).all()
    assert (distances_px(pixels, violation, np.full((4, 2), 640.0), 1468.0) >= 1468.0).all()


def test_kannala_brandt_sees_behind_its_own_plane():
    theta = np.radians(100.0)
    pixels, violation = project("kannala_brandt", K, [[np.sin(theta), 0.0, np.cos(theta)]])
    np.testing.assert_allclose(pixels, [[640.0 + 700.0 * theta, 360.0]])
    assert not violation.any()


def test_the_axis_is_the_principal_point():
    for model in MODELS:
        pixels, violation = project(model, K, [[0, 0, 1.0], [1e-13, 0, 1.0]])
        np.testing.assert_allclose(pixels, [[640, 360], [640, 360]], atol=1e-9)
        assert not violation.any()


@settings(deadline=None)
@given(st.floats(0, 100, width=32), st.floats(-100, 100, width=32))
def test_single_precision_angle(r, z):
    assume(r > 1e-6 or abs(z) > 1e-6)
    assert _angle(np.float32(r), np.float32(z)) == pytest.approx(np.arctan2(r, z), abs=6e-7)


@njit
def _angle(r, z):
    return polar_angle(r, z)


def test_bad_input_is_named():
    for lens, z, words in (
        ({"f_y": 1.0, "c_x": 0.0, "c_y": 0.0}, 1, "lack f_x"),
        (K, np.nan, "finite"),
        ([1.0], 1, "takes 4"),
    ):
        with pytest.raises(GeometryError, match=words):
            project("pinhole", lens, [[0, 0, z]])


LENSES = {
    "pinhole": [700, 710, 640, 360],
    "brown_conrady": [700, 710, 640, 360, 0.02, -0.2, 0.05, 0.001, -0.002, 0.01],
    "kannala_brandt": [700, 710, 640, 360, -0.05, -0.078, 0.096, -0.0515],
    "rational_polynomial": [700, 710, 640, 360, 0.6, -0.3, 0.001, -0.002, 0.05, 0.9, -0.25, 0.02],
}


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_are_those_of_the_projection(model):
    points = np.random.default_rng(1).uniform([-3, -2, 3], [3, 2, 10], (60, 3))
    points[0] = 0, 0, 5
    lens, step = np.array(LENSES[model], dtype=float), 1e-6
    assert not project(model, lens, points)[1].any()
    by_point, by_intrinsics = np.empty((60, 2, 3)), np.empty((60, 2, len(lens)))
    PROJECTIONS[model].jacobians_into(lens, points, by_point, by_intrinsics)
    for j in range(3):
        d = step * np.eye(3)[j]
        difference = project(model, lens, points + d)[0] - project(model, lens, points - d)[0]
        np.testing.assert_allclose(by_point[:, :, j], difference / (2 * step), atol=1e-6)
    for j in range(len(lens)):
        d = step * np.eye(len(lens))[j]
        difference = project(model, lens + d, points)[0] - project(model, lens - d, points)[0]
        np.testing.assert_allclose(by_intrinsics[:, :, j], difference / (2 * step), atol=1e-6)
