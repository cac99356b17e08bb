"""Transforms between cameras with honest deviations, marks of shared vertices, and what the rig states."""

import json

import numpy as np
import pytest

from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from apexcal.geometry.se3 import SE3, from_document
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.two_cameras import FRONT, LEFT, rig_of, solved, walked
from workers.solver.camera_transform import between_cameras, deviation, mount_covariance, normal_sigmas
from workers.solver.rig_consistency import StatedTransform, rig_consistency
from workers.solver.shared_vertices import vertex_keys

TRUE = FRONT.transform @ LEFT.transform.inverse()


def compared(cameras, *stated):
    (pair,) = rig_consistency(cameras, stated)
    found = pair.model_dump()
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    return found


def marked(seed):
    """Points, and marks of 1 px in both cameras."""
    points, pixels = walked(seed)
    rng = np.random.default_rng(seed)
    return points, [seen + rng.normal(size=seen.shape) for seen in pixels]


def known_mount(camera):
    covariance = mount_covariance(camera.problem, camera.result)
    assert covariance is not None
    return covariance


@few_or_many(14, 20)
def test_deviations_between_cameras_are_those_of_repeated_walks(draws):
    scores, freedoms = [], []
    for seed in range(draws):
        found = compared(rig_of(seed), StatedTransform(TRUE, "rig", 1e-9, 1e-9))
        scores.append(found["stated"][0]["chi2"])
        freedoms.append(found["stated"][0]["degrees_of_freedom"])
    assert set(freedoms) == {6}
    # A sum of chi-squared values of 6 degrees each: the mean is their number of degrees, the variance twice that.
    assert sum(scores) == pytest.approx(6.0 * draws, abs=4 * (12.0 * draws) ** 0.5)


@pytest.mark.parametrize("request_", [{}, {"locked": {"rotation_x": 0.03}}, {"locked": {"t_x": 0.1, "f_x": 600.0}}])
def test_the_covariance_is_the_derivative_of_the_composed_transform(request_):
    a, b = rig_of(3, **request_)
    # Small ones: a derivative says nothing of the second order, which counts from a few degrees on.
    mounts = [1e-4 * known_mount(one) for one in (a, b)]
    T, covariance = between_cameras(a.transform, mounts[0], b.transform, mounts[1])
    rng = np.random.default_rng(0)
    draws = []
    for _ in range(1000):
        moved = []
        for one, mount in zip((a, b), mounts, strict=True):
            d = rng.multivariate_normal(np.zeros(6), mount, method="eigh")
            R = rotation_from_vector(d[:3]) @ one.transform.R
            moved.append(SE3(one.transform.to_frame, "velodyne", R, one.transform.t + d[3:]))
        again = moved[0] @ moved[1].inverse()
        draws.append(np.concatenate([vector_from_rotation(again.R @ T.R.T), again.t - T.t]))
    np.testing.assert_allclose(np.std(draws, axis=0), np.sqrt(np.diag(covariance)), rtol=0.15)


def test_a_tip_is_one_vertex_whether_its_camera_has_marks_of_other_corners_or_not():
    tips = {"x": [1.0], "stamp_ns": [5], "sweep_index": [0]}
    assert vertex_keys(tips | {"corner": ["top"]}, True) == vertex_keys(tips, True)
    assert vertex_keys(tips | {"corner": ["left"]}, True) != vertex_keys(tips, True)


def test_a_prior_on_a_turn_changes_the_axes_and_not_the_deviations():
    free, _ = rig_of(4)
    hardly = {"rotation_x": {"mean": 0.0, "sigma": 1e3}}
    with_prior, _ = rig_of(4, priors=hardly)
    one, other = known_mount(free), known_mount(with_prior)
    np.testing.assert_allclose(other, one, rtol=0.02, atol=1e-10)


def test_the_same_vertex_agrees_within_the_noise_of_both_marks():
    for seed in range(3):
        shared = compared(rig_of(seed))["shared"]
        assert shared["vertices"] == 150 and shared["counted"] >= 149
        assert shared["rms_px"] == pytest.approx(shared["expected_rms_px"], rel=0.15)
        assert shared["offset_sigmas"] < 4.0
    assert compared(rig_of(0))["alarms"] == []


def test_a_mark_of_another_corner_stands_out_by_its_row_and_stamp():
    points, pixels = marked(7)
    pixels[1][31] += (25.0, 0.0)
    found = compared([solved(m, points, seen) for m, seen in zip((FRONT, LEFT), pixels, strict=True)])
    (odd,) = found["shared"]["odd"]
    assert (odd["indices"], odd["stamp_ns"]) == ([31, 31], 31)
    assert odd["distance_px"] == pytest.approx(25.0, abs=4.0)
    assert "1 stands out" in found["sentences"][-1]
    assert found["shared"]["counted"] == 149, "a pair judged an outlier says nothing of the cameras"


def test_a_camera_that_was_moved_between_marks_and_vertices_raises_an_alarm():
    """The left camera's intrinsics are locked wrongly, so that its rays do not meet the front camera's."""
    points, pixels = marked(8)
    wrong = {"locked": {"f_x": 700.0, "f_y": 700.0, "c_x": 639.5, "c_y": 479.5}}
    cameras = [solved(FRONT, points, pixels[0]), solved(LEFT, points, pixels[1], **wrong)]
    known = StatedTransform(TRUE, "rig", 0.05, 0.005)
    found = compared(cameras, known)
    assert found["stated"][0]["sigmas"] > 4.0
    assert any("disagrees with what the rig states" in alarm for alarm in found["alarms"])


@pytest.mark.parametrize("inverse", [False, True])
def test_stated_transforms_are_matched_by_their_frames_in_either_direction(inverse):
    cameras = rig_of(2)
    turned = SE3("front", "left", rotation_from_vector(np.radians([0.0, 0.0, 3.0])) @ TRUE.R, TRUE.t)
    other = SE3("front", "rear")
    nominal = StatedTransform(turned.inverse() if inverse else turned, "nominal")
    found = compared(cameras, nominal, StatedTransform(other, "rig"))
    (stated,) = found["stated"]
    assert (stated["source"], stated["std_deg"], stated["std_mm"]) == ("nominal", 10.0, 330.0)
    assert stated["rotation_deg"] == pytest.approx(3.0, abs=0.6)
    assert stated["sigmas"] < 1.0 and found["alarms"] == []
    (sentence,) = [one for one in found["sentences"] if "the nominal mount" in one]
    assert "agrees with" in sentence and "less than 1 sigma" in sentence
    tight = compared(cameras, StatedTransform(turned, "rig", 0.1, 0.002))
    assert tight["stated"][0]["sigmas"] > 4.0 and tight["alarms"]


def test_a_mount_that_the_pairs_leave_open_is_not_compared():
    points, pixels = walked(9)
    few = np.repeat(points[:1], 12, axis=0), np.repeat(pixels[1][:1], 12, axis=0)
    found = compared([solved(FRONT, points, pixels[0]), solved(LEFT, *few)], StatedTransform(TRUE, "rig"))
    assert found["transform"] is None and found["stated"] == []
    assert "do not determine the mount of left" in found["sentences"][0]


def test_vertices_are_told_by_sweep_in_one_detection_and_by_point_else():
    points, pixels = walked(10, 40)
    late = [stamp + 7 for stamp in range(40)]
    moved = points + np.array([0.02, 0.0, 0.0])
    apart = compared([solved(FRONT, points, pixels[0]), solved(LEFT, moved, pixels[1])])
    assert apart["shared"] is None and apart["sentences"][-1] == "No corner was marked in both front and left."
    together = compared(
        [solved(FRONT, points, pixels[0], detection="d"), solved(LEFT, moved, pixels[1], detection="d")]
    )
    assert together["shared"]["vertices"] == 40
    elsewhere = compared([solved(FRONT, points, pixels[0]), solved(LEFT, points, pixels[1], stamps=late)])
    assert elsewhere["shared"] is None


def test_sigmas_of_chi_squared_values():
    assert normal_sigmas(9.0, 1) == pytest.approx(3.0)
    assert normal_sigmas(5000.0, 6) == pytest.approx(np.sqrt(5000.0))
    assert normal_sigmas(0.0, 6) == 0.0
    exact = deviation(TRUE, np.zeros((6, 6)), TRUE, np.zeros((6, 6)))
    assert (exact.freedom, exact.sigmas, exact.probability) == (0, 0.0, 1.0)


def test_the_transform_of_the_document_maps_between_the_camera_frames():
    found = compared(rig_of(1, noise_px=1e-6))
    T = from_document(found["transform"])
    assert (T.to_frame, T.from_frame, found["name"]) == ("front", "left", "T_front_left")
    np.testing.assert_allclose(T.R, TRUE.R, atol=1e-6)
    np.testing.assert_allclose(T.t, TRUE.t, atol=1e-5)
