import cv2
import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numba import njit

from apexcal.documents.errors import GeometryError
from workers.geometry.models import INTRINSICS, MODELS
from workers.geometry.polar_angle import polar_angle
from workers.geometry.projection import (
    distances_px,
    fold_angle,
    image_diagonal_px,
    project,
    violation_cost_px,
)
from workers.geometry.projections.brown_conrady import brown_conrady_fold, brown_conrady_point
from workers.geometry.projections.kannala_brandt import kannala_brandt_fold, kannala_brandt_point
from workers.geometry.projections.pinhole import pinhole_point

K = {"f_x": 700.0, "f_y": 710.0, "c_x": 640.0, "c_y": 360.0}
NO_TURN = np.zeros(3)
k = st.floats(-1.0, 1.0)
small = st.floats(-0.02, 0.02)


def camera_matrix(f_x, f_y, c_x, c_y):
    return np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1.0]])


def field(seed=0, count=200, half_angle_deg=75.0):
    rng = np.random.default_rng(seed)
    theta = np.radians(rng.uniform(0, half_angle_deg, count))
    phi = rng.uniform(0, 2 * np.pi, count)
    directions = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    return directions * rng.uniform(1, 30, (count, 1))


def test_pinhole_is_opencvs():
    points = field()
    pixels, violation = project("pinhole", K, points)
    expected = cv2.projectPoints(points, NO_TURN, NO_TURN, camera_matrix(**K), None)[0].reshape(-1, 2)
    np.testing.assert_allclose(pixels, expected, atol=1e-9)
    assert not violation.any()


@settings(deadline=None)
@given(k, k, small, small, k, st.integers(0, 50))
def test_brown_conrady_is_opencvs_wherever_it_grows(k1, k2, k3, k4, k5, seed):
    points = field(seed)
    pixels, violation = project("brown_conrady", {**K, "k1": k1, "k2": k2, "k3": k3, "k4": k4, "k5": k5}, points)
    expected = cv2.projectPoints(points, NO_TURN, NO_TURN, camera_matrix(**K), np.array([k1, k2, k3, k4, k5]))[0]
    good = violation == 0.0
    np.testing.assert_allclose(pixels[good], expected.reshape(-1, 2)[good], atol=1e-6, rtol=1e-12)
    assert np.isnan(pixels[~good]).all()


@settings(deadline=None)
@given(k, k, k, k, st.integers(0, 50))
def test_kannala_brandt_is_opencvs_wherever_it_grows(k1, k2, k3, k4, seed):
    points = field(seed)
    pixels, violation = project("kannala_brandt", {**K, "k1": k1, "k2": k2, "k3": k3, "k4": k4}, points)
    expected = cv2.fisheye.projectPoints(
        points[:, None], NO_TURN, NO_TURN, camera_matrix(**K), np.array([k1, k2, k3, k4])
    )[0].reshape(-1, 2)
    good = violation == 0.0
    np.testing.assert_allclose(pixels[good], expected[good], atol=1e-6)


def test_skew_is_kept_where_opencv_drops_it():
    points = field(half_angle_deg=40)
    lens = {**K, "k1": -0.1, "k3": 0.01}
    straight, _ = project("brown_conrady", lens, points)
    skewed, _ = project("brown_conrady", {**lens, "skew": 0.05}, points)
    b_d = (straight[:, 1] - K["c_y"]) / K["f_y"]
    np.testing.assert_allclose(skewed[:, 0] - straight[:, 0], K["f_x"] * 0.05 * b_d, atol=1e-9)
    np.testing.assert_allclose(skewed[:, 1], straight[:, 1], atol=1e-12)


@settings(deadline=None)
@given(k, k, k)
@example(k1=0.1514, k2=0.9333, k5=-5.6e-16)
def test_brown_conrady_grows_up_to_its_fold_and_not_beyond(k1, k2, k5):
    fold = brown_conrady_fold(k1, k2, k5)

    def growth(r2):
        return 1 + 3 * k1 * r2 + 5 * k2 * r2**2 + 7 * k5 * r2**3

    if np.isfinite(fold):
        assert abs(growth(fold)) < 1e-6 * max(1.0, fold**3)
        # Even steps of the angle: rounding moves a fold by 90 degrees, at r^2 = 1e15, by 1e-8 degrees.
        inside = np.tan(np.linspace(0, np.arctan(np.sqrt(fold)), 400)[:-1]) ** 2
        # A dip that begins and ends inside one step of the fold's grid is allowed to be missed.
        assert np.mean(growth(inside) <= 0) < 0.05
    else:
        roots = np.roots([7 * k5, 5 * k2, 3 * k1, 1.0]) if abs(k5) > 1e-3 else np.array([])
        real = np.sort(roots[np.abs(roots.imag) < 1e-12].real)
        real = real[(real > 0) & (real < np.tan(np.radians(89)) ** 2)]
        assert len(real) == 0 or (len(real) >= 2 and np.arctan(real[1] ** 0.5) - np.arctan(real[0] ** 0.5) < 0.03)


@settings(deadline=None)
@given(k, k, k, k)
def test_kannala_brandt_grows_up_to_its_fold(k1, k2, k3, k4):
    fold = kannala_brandt_fold(k1, k2, k3, k4)
    theta = np.linspace(0, fold, 400)[:-1]
    growth = 1 + 3 * k1 * theta**2 + 5 * k2 * theta**4 + 7 * k3 * theta**6 + 9 * k4 * theta**8
    assert np.mean(growth <= 0) < 0.05
    assert 0 < fold <= np.pi


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


@njit(error_model="numpy")
def _single(model_id, x, y, z, c, fold):
    if model_id == 0:
        return pinhole_point(x, y, z, c[0], c[1], c[2], c[3])
    if model_id == 1:
        return brown_conrady_point(
            x, y, z, c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], fold
        )  # fmt: skip
    return kannala_brandt_point(x, y, z, c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], fold)


@pytest.mark.parametrize("model", MODELS)
def test_single_precision_is_the_same_projection(model):
    lens = {**K, "k1": -0.05, "k2": 0.01}
    points = field(half_angle_deg=60)
    pixels, _ = project(model, lens, points)
    values = np.array([lens.get(name, 0.0) for name in INTRINSICS[model]], dtype=np.float32)
    fold = np.float32(brown_conrady_fold(-0.05, 0.01, 0) if model == "brown_conrady" else np.pi)
    single = [_single(MODELS.index(model), *p, values, fold)[:2] for p in points.astype(np.float32)]
    np.testing.assert_allclose(single, pixels, atol=2e-3)


@settings(deadline=None)
@given(st.floats(0, 100, width=32), st.floats(-100, 100, width=32))
def test_single_precision_angle(r, z):
    assume(r > 1e-6 or abs(z) > 1e-6)
    assert _angle(np.float32(r), np.float32(z)) == pytest.approx(np.arctan2(r, z), abs=6e-7)


@njit
def _angle(r, z):
    return polar_angle(r, z)


def test_bad_input_is_named():
    with pytest.raises(GeometryError, match="lack f_x"):
        project("pinhole", {"f_y": 1.0, "c_x": 0.0, "c_y": 0.0}, [[0, 0, 1]])
    with pytest.raises(GeometryError, match="finite"):
        project("pinhole", K, [[0, 0, np.nan]])
    with pytest.raises(GeometryError, match="takes 4"):
        project("pinhole", [1.0, 2.0], [[0, 0, 1]])
